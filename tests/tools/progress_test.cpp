// tests/tools/progress_test.cpp — a bar that leaves nothing behind.
#include "tools/progress.h"

#include <gtest/gtest.h>

#include <sstream>

namespace {

double stopped() { return 0; }

/// What a terminal shows after the text: carriage returns overwrite; blanks at a line's end are not seen.
std::string screen(const std::string& text) {
    std::string shown, line;
    size_t cursor = 0;
    const auto seen = [&line] { return line.substr(0, line.find_last_not_of(' ') + 1); };
    for (char c : text) {
        if (c == '\r') {
            cursor = 0;
        } else if (c == '\n') {
            shown += seen() + '\n';
            line.clear();
            cursor = 0;
        } else {
            if (cursor == line.size()) line += ' ';
            line[cursor++] = c;
        }
    }
    return shown + seen();
}

TEST(Progress, WithoutATerminalOnlyWhatStaysIsSaid) {
    std::ostringstream out;
    {
        tools::Progress progress("work", out, false, stopped);
        for (size_t k = 1; k <= 100; ++k) progress.at(k, 100);
        progress.say("a warning");
    }
    EXPECT_EQ(out.str(), "a warning\n");
}

TEST(Progress, OnATerminalShowsABarAndRemovesIt) {
    std::ostringstream out;
    {
        tools::Progress progress("work", out, true, stopped);
        progress.at(0, 100);
        progress.at(50, 100);
        EXPECT_EQ(screen(out.str()), "work [##########..........] 50 %, 50 of 100");
        progress.say("a warning");
        EXPECT_EQ(screen(out.str()), "a warning\nwork [##########..........] 50 %, 50 of 100");
        progress.at(100, 100);
    }
    EXPECT_EQ(screen(out.str()), "a warning\n");
}

TEST(Progress, WritesOnlyWhatChanges) {
    std::ostringstream out;
    tools::Progress progress("work", out, true, stopped);
    progress.at(1, 1'000'000);
    const size_t written = out.str().size();
    for (size_t k = 2; k < 9999; ++k) progress.at(k, 1'000'000);
    EXPECT_EQ(out.str().size(), written);
}

TEST(Progress, TellsRateAndTimeLeftOfWhatItSaw) {
    double now = 1000;
    std::ostringstream terminal;
    {
        tools::Progress bar("work", terminal, true, [&] { return now; });
        const auto at = [&](double time, size_t done) {
            now = time;
            bar.at(done, 20'000);
        };
        at(1000, 1500);  // done before, in no time
        at(1010, 2000);
        EXPECT_EQ(screen(terminal.str()),
                  "work [##..................] 10 %, 2000 of 20000, 50/s, 6 min left");
        at(1010.5, 2003);
        EXPECT_EQ(screen(terminal.str()),
                  "work [##..................] 10 %, 2000 of 20000, 50/s, 6 min left");
        at(1011, 2005);  // the same percent a second later
        EXPECT_EQ(screen(terminal.str()),
                  "work [##..................] 10 %, 2005 of 20000, 45.9/s, 7 min left");
        at(101'100, 18'000);
        EXPECT_EQ(screen(terminal.str()), "work [##################..] 90 %, 18000 of 20000, 0.165/s, 3.4 h left");
        at(101'200, 20'000);
        EXPECT_EQ(screen(terminal.str()), "work [####################] 100 %, 20000 of 20000, 0.185/s");
    }
    EXPECT_EQ(screen(terminal.str()), "");
}

TEST(Progress, NothingToDoIsDone) {
    std::ostringstream out;
    tools::Progress progress("work", out, true, stopped);
    progress.at(0, 0);
    EXPECT_EQ(screen(out.str()), "work [####################] 100 %, 0 of 0");
}

}  // namespace
