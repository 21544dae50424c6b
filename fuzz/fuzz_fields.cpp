/// @file Displacement fields that other programs exported, of any format, into their common form.
#include "fuzz/support.hpp"
#include "knothe/files/fields/exported_field.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string& path = knothe::fuzz::write_scratch(data, size);
  knothe::fuzz::refuse_or_accept([&] {
    knothe::files::FieldMapping mapping;
    mapping.units = "mm";
    mapping.grid = {0, 0, 1, 1};
    for (knothe::files::ExportedField& field : knothe::files::read_exported_fields(path, mapping)) {
      if (!field.is_current) field.is_current = false;
      if (!field.is_up) field.is_up = true;
      knothe::files::settle_field(mapping, nullptr, field);
      if (field.u.size() != field.x.size() || field.v.size() != field.x.size()) std::abort();
    }
  });
  return 0;
}
