#include "server/pem.h"

#include <fstream>
#include <sstream>
#include <utility>

namespace server {

using world::Error;
using world::ErrorCode;

world::Result<TlsTexts> readTls(const TlsFiles& files) {
    TlsTexts texts;
    for (const auto& [path, to] : {std::pair(&files.certificate, &texts.certificate), std::pair(&files.key, &texts.key),
                                   std::pair(&files.authority, &texts.authority)}) {
        std::ifstream file(*path, std::ios::binary);
        std::ostringstream text;
        if (!file || !(text << file.rdbuf())) return Error{ErrorCode::kNotFound, "'" + *path + "': cannot be read; give a PEM file"};
        *to = text.str();
    }
    return texts;
}

}  // namespace server
