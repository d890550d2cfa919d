# Turns a file into a header with its bytes: cmake -D FILE=... -D ARRAY=kName -D NAMESPACE=... -D HEADER=... -P embed.cmake
file(READ ${FILE} bytes HEX)
string(REGEX REPLACE "([0-9a-f][0-9a-f])" "0x\\1," bytes "${bytes}")
file(WRITE ${HEADER} "#pragma once\nnamespace ${NAMESPACE} {\ninline constexpr unsigned char ${ARRAY}[] = {${bytes}};\n}\n")
