#!/bin/sh
# Prints the first of the Pythons named that runs here and that z2p can use, or nothing. A name such as python3.13 also
# means one that pyenv keeps without having it active: its command of that name only says so.
set -eu

for name in "$@"; do
    for one in "$name" "${PYENV_ROOT:-$HOME/.pyenv}/versions/${name#python}".*/bin/python3; do
        if "$one" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            command -v "$one"
            exit 0
        fi
    done
done
