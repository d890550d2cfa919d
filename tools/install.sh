#!/usr/bin/env bash
# Installs what is missing of tools/packages.txt, as root or through sudo; does nothing when all is there.
set -euo pipefail
list="$(dirname "$0")/packages.txt"

missing=()
while read -r package; do
    state=$(dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$state" = installed ] || missing+=("$package")
done < <(sed 's/#.*//' "$list" | awk 'NF {print $1}')
[ ${#missing[@]} -gt 0 ] || exit 0

asRoot=()
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || {
        echo "install.sh: run as root: apt-get install ${missing[*]}" >&2
        exit 1
    }
    asRoot=(sudo)
fi
echo "install.sh: installing ${missing[*]}" >&2
export DEBIAN_FRONTEND=noninteractive
"${asRoot[@]}" apt-get update -q
"${asRoot[@]}" apt-get install -q -y --no-install-recommends "${missing[@]}"
