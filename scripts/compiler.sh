#!/bin/sh
# Sees to the C compiler that builds z2p's kernels: installs one with apt where it may, else says how and fails.
set -eu

command -v "${CC:-cc}" >/dev/null && exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing a C compiler for z2p's kernels"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends gcc libc6-dev >/dev/null
else
    echo "z2p needs a C compiler, and there is no ${CC:-cc} here" >&2
    echo "install one, on Debian or Ubuntu with: sudo apt-get install gcc libc6-dev" >&2
    exit 1
fi
