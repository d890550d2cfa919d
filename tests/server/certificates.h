// tests/server/certificates.h — certificates made by openssl, good and bad ones.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <stdexcept>
#include <string>

#include "server/pem.h"
#include "tests/server/worlds.h"

namespace tests {

/// An authority, and certificates that it signed, or did not.
struct Certificates {
    std::string folder = temporary("certificates");
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

}  // namespace tests
