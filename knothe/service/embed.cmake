# cmake -DPAGE=index.html -DOUT=page.cpp -P embed.cmake: the page as an array of bytes.
if(EXISTS "${PAGE}")
  file(READ "${PAGE}" hex HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
  set(body "const unsigned char k_page[] = {${bytes}};\n")
else()
  set(body "const unsigned char k_page[] = \"<!doctype html><meta charset=utf-8><title>knothe</title><p>This knothe was built without its page (dashboard/dist/index.html). The service is here all the same: <a href=/v1/status>status</a>, <a href=/v1/state>state</a>, <a href=/v1/openapi.json>routes</a>.\";\n")
endif()
file(WRITE "${OUT}" "// Made by embed.cmake from dashboard/dist/index.html.\n#include <string_view>\n\nnamespace knothe::service {\nnamespace {\n${body}}  // namespace\n\nstd::string_view page();\nstd::string_view page() {\n  return {reinterpret_cast<const char*>(k_page), sizeof k_page};\n}\n\n}  // namespace knothe::service\n")
