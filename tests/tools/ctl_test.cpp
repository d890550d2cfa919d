// tests/tools/ctl_test.cpp — gnomon ctl beside a server that runs, and where there is none, or none that wants it.
#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <sstream>
#include <thread>

#include "tests/server/certificates.h"
#include "tests/server/clients.h"
#include "tests/tools/served.h"
#include "tools/image.h"

namespace {

namespace fs = std::filesystem;
namespace v1 = gnomon::v1;

tests::Said ctl(const std::string& arguments) { return tests::run(std::string(GNOMON_BINARY) + " ctl " + arguments); }

/// One line that says who speaks, names `word`, and ends with the status.
void expectRefusal(const std::string& arguments, int status, const std::string& word) {
    const auto start = std::chrono::steady_clock::now();
    const tests::Said said = ctl(arguments);
    EXPECT_EQ(said.status, status) << arguments << '\n' << said.text;
    EXPECT_EQ(std::count(said.text.begin(), said.text.end(), '\n'), 1) << said.text;
    EXPECT_TRUE(said.text.starts_with("gnomon: ")) << said.text;
    EXPECT_NE(said.text.find(word), std::string::npos) << said.text;
    EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(20)) << arguments;
}

std::string textOf(const std::string& path) {
    std::ifstream in(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
}

class Ctl : public testing::Test {
protected:
    const std::string folder_ = tests::temporary("ctl");
    const std::string token_ = folder_ + "/token", at_ = "--server unix:" + folder_ + "/socket ";
    std::optional<tests::Served> served_;
    std::optional<server::Client> client_;
    std::unique_ptr<server::ClientSession> session_;

    void SetUp() override {
        fs::create_directory(folder_);
        served_.emplace(tests::servedFolder(), "unix:" + folder_ + "/socket", std::vector<std::string>{"--operator", token_});
        client_ = std::move(server::Client::connect(served_->address()).value());
        session_ = std::move(client_->session(tests::openStreets()).value());
        for (uint64_t k = 0; k < 12; ++k) {
            auto reply = session_->frame(tests::lifeFrame(k));
            ASSERT_TRUE(reply);
            last_ = std::move(reply.value());
            for (const v1::Cascade& c : last_.cascades()) triangles_ += c.total().triangles() + c.active().triangles();
        }
    }
    v1::FrameReply last_;
    uint64_t triangles_ = 0;
};

TEST_F(Ctl, TellsOfServerWorldsAndSessions) {
    const tests::Said health = ctl("health " + at_);
    EXPECT_EQ(health.status, 0);
    EXPECT_NE(health.text.find("worlds 1, sessions 1"), std::string::npos) << health.text;
    EXPECT_EQ(ctl(at_ + "worlds").text, "streets\n");
    const tests::Said sessions = ctl("sessions " + at_);
    std::istringstream lines(sessions.text);
    std::string header;
    std::getline(lines, header);
    double number = 0, seconds = 0, frames = 0, ms = 0, wait = 0, triangles = 0, resident = 0, errors = 0;
    std::string world, more;
    ASSERT_TRUE(lines >> number >> seconds >> frames >> ms >> wait >> triangles >> resident >> errors >> world) << sessions.text;
    EXPECT_FALSE(lines >> more) << sessions.text;
    EXPECT_EQ(number, 1);
    EXPECT_EQ(frames, 12);
    EXPECT_GT(ms, 0);
    EXPECT_NEAR(triangles, double(triangles_) / 12, 0.5);  // printed whole
    EXPECT_EQ(errors, 2);
    EXPECT_EQ(world, "streets");
    EXPECT_EQ(sessions.text.find(session_->opened().session()), std::string::npos) << "a secret is told";
}

TEST_F(Ctl, DumpsAMapForItsOwnerAndTheOperator) {
    const std::string dump = at_ + "dump ", secret = session_->opened().session();
    ASSERT_EQ(ctl(dump + secret + " 1 -o " + folder_ + "/mine.pfm").status, 0);
    const tests::Said said = ctl(dump + "1 1 --working --operator " + token_ + " -o " + folder_ + "/theirs.pfm");
    ASSERT_EQ(said.status, 0) << said.text;
    ASSERT_EQ(ctl(dump + secret + " 1 -o " + folder_ + "/mine.png").status, 0);

    // Texel by texel what the call itself gives, in the order of the window.
    v1::GetDepthMapRequest request;
    request.set_session(secret);
    request.set_cascade(1);
    request.set_tile(256);
    const auto tiles = client_->depthMap(request);
    ASSERT_TRUE(tiles);
    ASSERT_EQ(tiles.value().size(), 1u);
    const std::string stored = tiles.value()[0].depths(), pfm = textOf(folder_ + "/mine.pfm"), head = "Pf\n256 256\n-1.0\n";
    ASSERT_EQ(pfm.size(), head.size() + stored.size());
    ASSERT_TRUE(pfm.starts_with(head));
    const v1::Cascade& cascade = last_.cascades(1);
    for (int64_t y = 0; y < 256; ++y)
        for (int64_t x = 0; x < 256; ++x) {
            const auto slot = [](int64_t t) { return size_t((t % 256 + 256) % 256); };
            const size_t in = slot(cascade.window_y() + y) * 256 + slot(cascade.window_x() + x), out = size_t(255 - y) * 256 + size_t(x);
            ASSERT_EQ(std::memcmp(stored.data() + in * 4, pfm.data() + head.size() + out * 4, 4), 0) << x << ' ' << y;
        }
    EXPECT_EQ(textOf(folder_ + "/theirs.pfm").size(), pfm.size());
    EXPECT_TRUE(textOf(folder_ + "/mine.png").starts_with("\x89PNG"));

    EXPECT_EQ(fs::status(token_).permissions(), fs::perms::owner_read | fs::perms::owner_write);
    expectRefusal(dump + "1 1 -o " + folder_ + "/a.pfm", 2, "--operator");
    std::ofstream(folder_ + "/wrong") << "0123456789abcdef0123456789abcdef\n";
    expectRefusal(dump + "1 1 --operator " + folder_ + "/wrong -o " + folder_ + "/a.pfm", 3, "session");
    expectRefusal(dump + "1 1 --operator " + folder_ + "/nowhere -o " + folder_ + "/a.pfm", 3, "nowhere");
    expectRefusal(dump + "7 1 --operator " + token_ + " -o " + folder_ + "/a.pfm", 3, "session");
    expectRefusal(dump + secret + " 9 -o " + folder_ + "/a.pfm", 2, "cascade");
    expectRefusal(dump + secret + " 1 -o " + folder_ + "/a.jpg", 2, ".pfm");
    expectRefusal(dump + secret + " 1 -o " + folder_ + "/none/a.pfm", 3, "none/a.pfm");
    EXPECT_FALSE(fs::exists(folder_ + "/a.pfm"));
}

TEST_F(Ctl, TailsWhatIsDrawnMeanwhile) {
    tests::Said said;
    std::thread watching([&] { said = ctl("tail 1 --lines 2 " + at_); });
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(4);
    for (uint64_t k = 12; std::chrono::steady_clock::now() < until; ++k) {
        ASSERT_TRUE(session_->frame(tests::lifeFrame(k)));
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    watching.join();
    ASSERT_EQ(said.status, 0) << said.text;
    std::istringstream lines(said.text);
    std::string header;
    std::getline(lines, header);
    for (int line = 0; line < 2; ++line) {
        double sessions = 0, pace = 0, ms = 0, wait = 0, texels = 0, triangles = 0, errors = 0;
        ASSERT_TRUE(lines >> sessions >> pace >> ms >> wait >> texels >> triangles >> errors) << said.text;
        EXPECT_EQ(sessions, 1);
        EXPECT_GT(pace, 0);
        EXPECT_LT(pace, 51);  // a frame each 20 ms at the most
        EXPECT_GT(ms, 0);
    }
    expectRefusal("tail 5 " + at_, 3, "session 5");
    expectRefusal("tail one " + at_, 2, "one");
    ASSERT_TRUE(session_->close());
}

TEST_F(Ctl, SaysWhereNoServerIs) {
    expectRefusal("health --server unix:" + folder_ + "/nobody", 3, "nobody");
    expectRefusal("tail --server 127.0.0.1:1", 3, "127.0.0.1:1");
    expectRefusal("health --cert a --key b", 2, "--ca");
    expectRefusal("", 2, "subcommand");
    served_->freeze();
    expectRefusal("worlds " + at_, 3, "no server answers");
    served_->stop();
    expectRefusal("sessions " + at_, 3, "gnomon serve");
}

TEST(CtlWithTls, ShowsItsCertificate) {
    const tests::Certificates made;
    const server::TlsFiles own = made.files("server");
    // A port that was free a moment ago: the server takes it, and TLS needs an address that a certificate can name.
    server::ServiceConfig probe = tests::serviceConfig();
    const std::string address = tests::Running(probe).service->address();
    const tests::Served served(tests::servedFolder(), address,
                               {"--tls-certificate", own.certificate, "--tls-key", own.key, "--tls-clients", own.authority}, made.files("client"));
    const auto with = [&](const std::string& who, const std::string& trusts) {
        const server::TlsFiles files = made.files(who, trusts);
        return "worlds --server " + address + " --cert " + files.certificate + " --key " + files.key + " --ca " + files.authority;
    };
    EXPECT_EQ(ctl(with("client", "ours")).text, "streets\n");
    expectRefusal(with("stranger", "ours"), 3, "certificates");
    expectRefusal(with("expired", "ours"), 3, "certificates");
    expectRefusal(with("client", "theirs"), 3, "certificates");
    expectRefusal("worlds --server " + address, 3, "TLS");
    expectRefusal("worlds --server " + address + " --cert nowhere --key nowhere --ca nowhere", 3, "nowhere");
}

}  // namespace
