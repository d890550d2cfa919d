// tests/tools/progress_test.cpp — a bar that leaves nothing behind, or ten lines.
#include "tools/progress.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <sstream>

namespace {

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

size_t lines(const std::string& text) { return size_t(std::count(text.begin(), text.end(), '\n')); }

TEST(Progress, WithoutATerminalPrintsALineEveryTenth) {
    for (size_t total : {1u, 7u, 10u, 1000u, 12345u}) {
        std::ostringstream out;
        {
            tools::Progress progress("work", out, false);
            for (size_t k = 1; k <= total; ++k) progress.at(k, total);
        }
        EXPECT_EQ(lines(out.str()), std::min<size_t>(total, 10)) << total;
        EXPECT_NE(out.str().find("100 %, " + std::to_string(total) + " of"), std::string::npos);
        EXPECT_EQ(out.str().find('\r'), std::string::npos);
    }
}

TEST(Progress, OnATerminalShowsABarAndRemovesIt) {
    std::ostringstream out;
    {
        tools::Progress progress("work", out, true);
        progress.at(0, 100);
        progress.at(50, 100);
        EXPECT_EQ(screen(out.str()), "work [" + std::string(20, '#') + std::string(20, '.') + "] 50 of 100");
        progress.say("a warning");
        EXPECT_EQ(screen(out.str()),
                  "a warning\nwork [" + std::string(20, '#') + std::string(20, '.') + "] 50 of 100");
        progress.at(100, 100);
    }
    EXPECT_EQ(screen(out.str()), "a warning\n");
}

TEST(Progress, WritesOnlyWhatChanges) {
    std::ostringstream out;
    tools::Progress progress("work", out, true);
    progress.at(1, 1'000'000);
    const size_t written = out.str().size();
    for (size_t k = 2; k < 9999; ++k) progress.at(k, 1'000'000);
    EXPECT_EQ(out.str().size(), written);
}

TEST(Progress, NothingToDoIsDone) {
    std::ostringstream out;
    tools::Progress progress("work", out, false);
    progress.at(0, 0);
    EXPECT_EQ(out.str(), "work: 100 %, 0 of 0\n");
}

}  // namespace
