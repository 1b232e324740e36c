#!/bin/sh
# Sees to the system libraries that open3d loads: installs them with apt where it may, else names them and fails.
set -eu

PACKAGES="libusb-1.0-0 libgl1 libegl1 libx11-6"

[ "$(uname -s)" = Linux ] || exit 0

known=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p)
missing=""
for library in libusb-1.0.so.0 libGL.so.1 libEGL.so.1 libX11.so.6; do
    case "$known" in
        *"$library"*) ;;
        *) missing="$missing $library" ;;
    esac
done
[ -n "$missing" ] || exit 0

if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing the system libraries that open3d needs:$missing"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    # shellcheck disable=SC2086 - one word a package
    apt-get install -y -qq --no-install-recommends $PACKAGES >/dev/null
else
    echo "open3d needs these system libraries:$missing" >&2
    echo "install them, on Debian or Ubuntu with: sudo apt-get install $PACKAGES" >&2
    exit 1
fi
