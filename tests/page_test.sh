#!/usr/bin/env bash
# Opens pages of reports in a browser, at desktop and phone width: their scripts run to the end, say nothing on the
# console, and ask for nothing from anywhere.
#   tests/page_test.sh GNOMON
# Status 77 where there is no Chromium.
set -euo pipefail
command -v chromium >/dev/null || exit 77
source "$(dirname "$0")/bake_scratch.sh"
small_dem 60 > dem.asc
awk 'BEGIN { for (k = 0; k < 90; ++k) printf "%.4f %.3f 90 -300 0 0 0 1\n", k / 30, 200 + k }' > flight.tum
"$gnomon" bake dem.asc -o hills.world --sun 135,40 >log 2>&1 || fail "the bake"
"$gnomon" replay hills.world --path flight.tum --resolution 128 --spot 250,100,-300,0,-1,0.1,40,200 --results runs.sqlite \
    --dump pictures >log 2>&1 || fail "the replay"
"$gnomon" stress hills.world --path flight.tum --case path --seconds 2 --resolution 128 --results runs.sqlite >log 2>&1 || fail "the stress"
"$gnomon" soak hills.world --frames 40 --results runs.sqlite >log 2>&1 || fail "the soak"
"$gnomon" lab hills.world --path flight.tum --methods gnomon,single --results runs.sqlite >log 2>&1 || fail "the lab"
"$gnomon" report 'runs.sqlite#1' 'runs.sqlite#2' 'runs.sqlite#3' 'runs.sqlite#4' -o report.html >log 2>&1 || fail "the report"

# browse FILE MS: what the page comes to in `dom`, what it says in `log`, what it asks for in `net.json`.
browse() {
    timeout 120 chromium --headless --no-sandbox --disable-gpu --user-data-dir="$work/profile" --allow-file-access-from-files \
        --enable-logging=stderr --log-net-log="$work/net.json" --virtual-time-budget="$2" --dump-dom "file://$work/$1" \
        >dom 2>log || fail "Chromium on $1"
}
# Whether a page asked for something: Chromium's own requests, for updates, have no origin.
asks() { grep -oE '"initiator":"(null|file:[^"]*)"' net.json; }
echo '<img src="http://127.0.0.1:9/"><script>nothing.at.all()</script>' > bad.html
browse bad.html 2000
asks >/dev/null || fail "a page that asks for something is not seen"
grep -q CONSOLE log || fail "a page with an error is not seen"

# The page in a frame of a given width, since windows have a least one; each run of it is chosen once.
open() {
    cat > frame.html <<END
<body><iframe id="f" src="report.html" style="width: $1px; height: 4000px"></iframe><p id="said"></p>
<script>
const f = document.getElementById('f'), told = [];
f.addEventListener('load', () => {
    const d = f.contentDocument;
    for (const choice of d.querySelectorAll('input[type=radio]')) choice.click();
    for (const choice of d.querySelectorAll('input[name=run]')) {
        choice.click();
        told.push(d.getElementById('title').textContent.length > 10, d.documentElement.scrollWidth <= $1);
        for (const table of d.querySelectorAll('main table')) if (!table.closest('[hidden]')) told.push(table.rows.length > 1);
    }
    d.querySelector('input[name=run]').click();
    d.getElementById('slider').value = 3;
    d.getElementById('slider').dispatchEvent(new Event('input'));
    told.push(d.getElementById('frame').textContent.includes('Frame 3'), d.querySelectorAll('#dearest article').length > 0);
    told.push(d.querySelectorAll('.pictures img').length > 0);
    document.getElementById('said').textContent = 'told ' + told.length + ' ' + told.every(Boolean) + ' ' + told.indexOf(false);
});
</script>
END
    browse frame.html 20000
    ! grep -E "CONSOLE" log || fail "the page says something on the console at $1 pixels"
    grep -qE 'told [0-9]{2,} true' dom || fail "what the page shows at $1 pixels: $(grep -oE 'id="said">[^<]*' dom)"
    ! asks || fail "the page asks for something at $1 pixels"
}
open 1280
open 390
echo "the page: quiet and whole at two widths"
