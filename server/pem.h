// server/pem.h — certificates and keys from files.
#pragma once

#include <string>

#include "world/result.h"

namespace server {

/// Files in PEM format: one's own certificate and key, and the authority that must have signed the other side's.
struct TlsFiles {
    std::string certificate, key, authority;
};

struct TlsTexts {
    std::string certificate, key, authority;
};

/// kNotFound names the file that cannot be read.
world::Result<TlsTexts> readTls(const TlsFiles& files);

}  // namespace server
