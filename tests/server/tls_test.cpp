// Mutual TLS: who shows a good certificate is served, and nobody else.
#include "tests/server/certificates.h"
#include "tests/server/clients.h"

namespace {

TEST(Tls, ServesWhoShowsAGoodCertificateAndNobodyElse) {
    const auto host = tests::localHost();
    const tests::Certificates certificates;
    server::ServiceConfig config = tests::serviceConfig();
    config.tls = certificates.files("server");
    const tests::Running running(config);
    const std::string address = running.service->address();
    EXPECT_TRUE(server::Client::connect(address, certificates.files("client")).value().healthy());
    EXPECT_FALSE(server::Client::connect(address).value().healthy(1)) << "no TLS";
    EXPECT_FALSE(server::Client::connect(address, certificates.files("stranger")).value().healthy(1));
    EXPECT_FALSE(server::Client::connect(address, certificates.files("expired")).value().healthy(1));
    EXPECT_FALSE(server::Client::connect(address, certificates.files("client", "theirs")).value().healthy(1)) << "the server's is not theirs";
    EXPECT_TRUE(server::Client::connect(address, certificates.files("client")).value().healthy()) << "and still it serves";
    config.tls->key = "nowhere";
    const auto missing = server::Service::start(*host, config, {});
    ASSERT_FALSE(missing);
    EXPECT_NE(missing.error().what.find("nowhere"), std::string::npos);
}

TEST(Tls, LetsOtherAddressesBeListenedOn) {
    const auto host = tests::localHost();
    const tests::Certificates certificates;
    server::ServiceConfig config = tests::serviceConfig();
    config.listen = "0.0.0.0:0";
    config.tls = certificates.files("server");
    EXPECT_TRUE(server::Service::start(*host, config, {}));
}

}  // namespace
