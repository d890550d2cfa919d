# tests/bake_scratch.sh — to be sourced by a test whose first argument is the program: a folder to bake in, where the
# test goes on and which leaves with it, and something to bake.

gnomon=$(realpath "$1")
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"

# fail WHAT: ends the test. Runs leave what they say in `log`.
fail() {
    echo "FAILED: $*; the last run said:" >&2
    cat log >&2
    exit 1
}
# content WORLD: the hash of its content, once every checksum and invariant holds.
content() { "$gnomon" info "$1" --check | sed -n 's/^content *//p'; }

# small_dem POSTS: hills with noise on POSTS x POSTS posts 10 m apart; 700 posts bake into some 21 MiB.
small_dem() {
    awk -v n="$1" 'BEGIN {
        srand(1)
        printf "ncols %d\nnrows %d\nxllcorner 0\nyllcorner 0\ncellsize 10\n", n, n
        for (r = 0; r < n; ++r) {
            for (c = 0; c < n; ++c) printf "%.2f ", 80 * sin(r / 40) * cos(c / 55) + 6 * rand()
            print ""
        }
    }'
}

# blocks KIND DOCUMENT: what stands in a document's blocks of that kind, a regular expression.
blocks() { awk -v begin="^\`\`\`$1\$" '$0 ~ begin { on = 1; next } /^```$/ { on = 0 } on' "$2"; }
