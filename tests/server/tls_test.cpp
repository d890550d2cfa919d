// Mutual TLS: who shows a good certificate is served, and nobody else. The certificates are made by openssl.
#include <cstdlib>

#include "tests/server/clients.h"

namespace {

/// An authority, and certificates that it signed, or did not.
struct Certificates {
    std::string folder = tests::temporary("certificates");
    Certificates() {
        std::filesystem::create_directory(folder);
        authority("ours");
        authority("theirs");
        issue("server", "ours", "-days 2");
        issue("client", "ours", "-days 2");
        issue("stranger", "theirs", "-days 2");
        issue("expired", "ours", "-days -1");
    }
    server::TlsFiles files(const std::string& who, const std::string& trusts = "ours") const {
        return {folder + "/" + who + ".pem", folder + "/" + who + ".key", folder + "/" + trusts + ".pem"};
    }

private:
    void run(const std::string& command) const {
        if (std::system(("cd " + folder + " && " + command + " >openssl.log 2>&1").c_str()) != 0)
            throw std::runtime_error("openssl: " + command);
    }
    void authority(const std::string& name) const {
        run("openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj /CN=" + name + " -days 2 -keyout " + name +
            ".key -out " + name + ".pem");
    }
    void issue(const std::string& name, const std::string& by, const std::string& days) const {
        run("openssl req -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -subj /CN=" + name + " -keyout " + name + ".key -out " +
            name + ".csr");
        run("printf 'subjectAltName=IP:127.0.0.1' > san && openssl x509 -req -in " + name + ".csr -CA " + by + ".pem -CAkey " + by +
            ".key -CAcreateserial -extfile san " + days + " -out " + name + ".pem");
    }
};

TEST(Tls, ServesWhoShowsAGoodCertificateAndNobodyElse) {
    const auto host = tests::localHost();
    const Certificates certificates;
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
    const Certificates certificates;
    server::ServiceConfig config = tests::serviceConfig();
    config.listen = "0.0.0.0:0";
    config.tls = certificates.files("server");
    EXPECT_TRUE(server::Service::start(*host, config, {}));
}

}  // namespace
