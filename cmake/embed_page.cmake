# cmake -DPAGE=index.html -DNAME=page -DNAMESPACE=knothe::service -DOTHERWISE=text -DOUT=page.cpp -P embed_page.cmake: a page of
# dashboard/dist as an array of bytes, behind a function of that name; the other text where the page was not built.
if(EXISTS "${PAGE}")
  file(READ "${PAGE}" hex HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
else()
  string(HEX "${OTHERWISE}" hex)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
endif()
file(WRITE "${OUT}" "// Made by embed_page.cmake.\n#include <string_view>\n\nnamespace ${NAMESPACE} {\nnamespace {\nconst unsigned char k_page[] = {${bytes}};\n}  // namespace\n\nstd::string_view ${NAME}();\nstd::string_view ${NAME}() {\n  return {reinterpret_cast<const char*>(k_page), sizeof k_page};\n}\n\n}  // namespace ${NAMESPACE}\n")
