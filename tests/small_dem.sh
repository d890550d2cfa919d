# tests/small_dem.sh — to be sourced: a seeded elevation model as text.

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
