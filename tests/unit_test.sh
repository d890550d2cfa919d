#!/usr/bin/env bash
# The systemd unit: nothing in it is unknown or wrong, it leaves the service few rights, what docs/serve.md says installs and enables
# it, and its command serves with the configuration that is shown there until SIGTERM ends it, in the time that the unit gives it.
#   tests/unit_test.sh GNOMON UNIT DOCUMENT
# Status 77 where there is no systemd-analyze.
set -euo pipefail
command -v systemd-analyze >/dev/null || { echo "no systemd-analyze: skipped"; exit 77; }
unit=$(realpath "$2") document=$(realpath "$3")
source "$(dirname "$0")/bake_scratch.sh"

command=$(sed -n 's/^ExecStart=//p' "$unit")
sed "s|^ExecStart=[^ ]*|ExecStart=$gnomon|" "$unit" > gnomon.service
systemd-analyze verify ./gnomon.service > log 2>&1 || fail "the unit"
[[ ! -s log ]] || fail "the unit"
systemd-analyze security --offline=true --threshold=25 ./gnomon.service > log 2>&1 || fail "the unit leaves more rights than it did"
echo "Nonsense=1" >> gnomon.service
systemd-analyze verify ./gnomon.service > log 2>&1 || true
[[ -s log ]] || fail "a unit with nonsense is not seen"

# What installs it, below a folder that stands for the machine; starting it is up to a systemd that runs.
blocks "sh systemd" "$document" > commands
mkdir -p sources/build/release/tools sources/tools machine/usr/local/bin machine/etc/systemd/system
ln -s "$gnomon" sources/build/release/tools/gnomon
ln -s "$unit" sources/tools/
sed -i "s| /usr| $work/machine/usr|; s| /etc| $work/machine/etc|; s|^systemctl enable --now |systemctl --root=$work/machine enable |" commands
(cd sources && bash -euo pipefail ../commands) > log 2>&1 || fail "what installs the unit"
[[ -x machine/usr/local/bin/gnomon && -L machine/etc/systemd/system/multi-user.target.wants/gnomon.service ]] || fail "what installs the unit"

blocks toml "$document" > serve.toml
[[ -s serve.toml ]] || { : > log; fail "the document has no configuration"; }
mkdir worlds recordings run
sed -i "s|/srv/gnomon|$work/worlds|; s|/var/lib/gnomon|$work/recordings|; s|/run/gnomon|$work/run|; s|50471|0|; s|8080|0|" serve.toml
[[ $command == "/usr/local/bin/gnomon "*" /etc/gnomon/serve.toml" ]] || { : > log; fail "the unit's command: $command"; }
words=${command#/usr/local/bin/gnomon }
# shellcheck disable=SC2086  # words of the command
"$gnomon" ${words%/etc/gnomon/serve.toml} serve.toml > log 2>&1 &
server=$!
trap 'kill -9 $server 2>/dev/null || true; rm -rf "$work"' EXIT
for _ in $(seq 300); do grep -q '"page"' log && break; kill -0 $server || fail "the unit's command"; sleep 0.1; done
address=$(sed -n 's/.*"listening","detail":"\([^"]*\)".*/\1/p' log)
"$gnomon" ctl health --server "$address" >health 2>&1 || { cat health >> log; fail "health at $address"; }
[[ $(stat -c %a run/operator) == 600 ]] || fail "the operator's token"
limit=$(sed -n 's/^TimeoutStopSec=//p' "$unit") begun=$SECONDS
kill -TERM $server
wait $server || fail "the end by SIGTERM: status $?"
(( SECONDS - begun < limit )) || fail "the end by SIGTERM took longer than the unit lets it"
echo "the unit: verified, and its command serves and stops"
