#!/bin/sh
# Installs a software Vulkan driver (lavapipe), so that cameras and films work without a GPU.
#
# Debian 12, as root:   scripts/install_lavapipe.sh
#
# SAPIEN needs Mesa 24.3 or newer (VK_KHR_external_semaphore_fd); Debian 12 has it in its backports. They are
# taken from the mirror that this machine already uses. Running it twice is harmless.
set -eu

sources=${APT_SOURCES_FILE:-/etc/apt/sources.list.d/debian.sources}
release=bookworm
wanted="mesa-vulkan-drivers libvulkan1"

if [ "$(id -u)" != 0 ]; then
    echo "install_lavapipe.sh: run it as root (it installs $wanted)" >&2
    exit 2
fi
if ! grep -qs "^VERSION_CODENAME=$release" /etc/os-release; then
    echo "install_lavapipe.sh: written for Debian 12 ($release); elsewhere install Mesa 24.3 or newer" >&2
    exit 2
fi
if [ ! -r "$sources" ]; then
    echo "install_lavapipe.sh: no $sources; set APT_SOURCES_FILE to this machine's deb822 file" >&2
    exit 2
fi

# The first stanza of the sources file is Debian's own archive: the same one serves the backports.
awk -v suite="$release-backports" '
    BEGIN { RS = ""; ORS = "\n\n" }
    NR == 1 { sub(/Suites:[^\n]*/, "Suites: " suite); print }
' "$sources" > /etc/apt/sources.list.d/dore-backports.sources

apt-get update
# shellcheck disable=SC2086  # the list of packages is meant to be split
DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends -t "$release-backports" $wanted
