// tests/tools/kill_edit_test.cpp — kills `gnomon edit` at random moments: what it acknowledged is in the world, and the
// world is sound.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <random>
#include <thread>

#include "tests/world/hills_world.h"
#include "world/edited_terrain.h"
#include "world/record_text.h"

namespace {

using namespace world;
using Clock = std::chrono::steady_clock;

constexpr int kEdits = 25;

/// GNOMON_KILLS of them, or few enough for every day.
int kills() {
    const char* text = std::getenv("GNOMON_KILLS");
    return text ? std::atoi(text) : 10;
}

/// `gnomon edit` at work.
class Child {
public:
    Child(const std::string& world, const std::string& edits) {
        int ends[2];
        CHECK(::pipe2(ends, O_CLOEXEC) == 0);
        posix_spawn_file_actions_t actions;
        posix_spawn_file_actions_init(&actions);
        posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
        std::string program = GNOMON_BINARY, command = "edit", first = world, second = edits;
        char* arguments[] = {program.data(), command.data(), first.data(), second.data(), nullptr};
        CHECK(::posix_spawn(&pid_, program.c_str(), &actions, nullptr, arguments, environ) == 0);
        posix_spawn_file_actions_destroy(&actions);
        ::close(ends[1]);
        out_ = ends[0];
    }
    void kill() { ::kill(pid_, SIGKILL); }
    /// Waits for its end; how many edits it has acknowledged.
    int acknowledged() {
        std::string text;
        char buffer[4096];
        for (ssize_t got = 0; (got = ::read(out_, buffer, sizeof buffer)) > 0;) text.append(buffer, size_t(got));
        ::close(out_);
        int status = 0;
        ::waitpid(pid_, &status, 0);
        return static_cast<int>(std::count(text.begin(), text.end(), '\n'));
    }

private:
    pid_t pid_ = 0;
    int out_ = -1;
};

TEST(KillEdit, WhatWasAcknowledgedIsThere) {
    world_tests::TempFolder folder;
    const std::string baked = folder.file("baked"), path = folder.file("w"), list = folder.file("edits.txt");
    ASSERT_TRUE(bake(test::hillsWorld(3, 16, 2), baked, {}));
    std::mt19937 rng(3);
    const auto uniform = [&rng](double a, double b) { return std::uniform_real_distribution<double>(a, b)(rng); };

    // What the world holds after each number of edits.
    std::filesystem::copy_file(baked, path);
    std::vector<uint64_t> hashes{WorldStore::open(path).value().contentHash().value()};
    std::vector<TerrainEdit> edits;
    {
        const Result<WorldStore> store = WorldStore::open(path);
        Result<WorldEditor> editor = WorldEditor::open(path);
        ASSERT_TRUE(store && editor);
        EditedTerrain terrain(store.value(), &editor.value());
        std::string text;
        while (hashes.size() <= kEdits) {
            const Sphere sphere{{uniform(10, 86), uniform(-20, 15), uniform(10, 86)}, uniform(3, 9)};
            const bool dig = rng() % 2;
            const TerrainEdit edit{dig ? EditKind::kDig : EditKind::kFill, sphere};
            const auto changed = terrain.apply(edit);
            ASSERT_TRUE(changed) << changed.error().what;
            if (changed.value().empty()) continue;
            text += dig ? "dig sphere" : "fill sphere";
            for (const double number : {sphere.centre.x, sphere.centre.y, sphere.centre.z, sphere.radius}) {
                text += ' ';
                appendNumber(text, number);
            }
            text += '\n';
            hashes.push_back(store.value().contentHash().value());
            edits.push_back(edit);
        }
        world_tests::writeFile(list, text);
    }
    const auto fresh = [&] { std::filesystem::copy_file(baked, path, std::filesystem::copy_options::overwrite_existing); };
    fresh();
    const auto begun = Clock::now();
    ASSERT_EQ(Child(path, list).acknowledged(), kEdits);
    const double whole = std::chrono::duration<double>(Clock::now() - begun).count();
    EXPECT_EQ(WorldStore::open(path).value().contentHash().value(), hashes.back());

    int cutShort = 0, torn = 0;
    for (int n = 0; n < kills(); ++n) {
        fresh();
        Child child(path, list);
        std::this_thread::sleep_for(std::chrono::duration<double>(uniform(0, whole)));
        child.kill();
        const int acknowledged = child.acknowledged();
        cutShort += acknowledged < kEdits;
        torn += std::filesystem::exists(path + "-journal");
        const Result<WorldStore> store = WorldStore::open(path);
        ASSERT_TRUE(store) << store.error().what;
        for (const Error& finding : store.value().check()) ADD_FAILURE() << finding.what;
        // The next one may be there without having been acknowledged.
        auto there = static_cast<size_t>(acknowledged);
        const uint64_t hash = store.value().contentHash().value();
        if (hash != hashes[there]) ++there;
        ASSERT_TRUE(there < hashes.size() && hash == hashes[there])
            << "round " << n << ": " << acknowledged << " were acknowledged";
        if (there == edits.size()) continue;
        // And the world goes on from there, by itself.
        Result<WorldEditor> editor = WorldEditor::open(path);
        ASSERT_TRUE(editor) << editor.error().what;
        ASSERT_TRUE(EditedTerrain(store.value(), &editor.value()).apply(edits[there]));
        EXPECT_EQ(store.value().contentHash().value(), hashes[there + 1]);
        EXPECT_FALSE(std::filesystem::exists(path + "-journal"));
    }
    EXPECT_GT(cutShort, 0);
    std::printf("%d kills, %d before the end, %d within a commit\n", kills(), cutShort, torn);
}

}  // namespace
