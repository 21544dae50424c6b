#pragma once
/// @file For this room's tests: is a text well-formed XML, and an assimilation that looks like the paper's.
#include <string>

#include "knothe/files/testing/test_folder.hpp"
#include "knothe/model/reduced/separated_model.hpp"

namespace knothe::record::test {

/// Empty if `text` is well-formed (every element closed in order, attributes quoted, entities known), else
/// what is wrong.
[[nodiscard]] std::string xml_fault(const std::string& text);

/// The same of a page, whose scripts and style are left out, as is its first line.
[[nodiscard]] std::string html_fault(const std::string& page);

/// How often `part` occurs in `text`.
[[nodiscard]] std::size_t count_of(const std::string& text, const std::string& part);

/// Writes steps.jsonl and summary.json of a made-up assimilation of `steps` steps into the folder, and
/// returns its name. The posterior narrows while the crack runs (steps 16–40).
[[nodiscard]] std::string write_results(const files::TestFolder& folder, int steps = 100);

/// A beam of 42 × 5 hexahedra with two parameters, in either form, with a mesh and crack solutions.
[[nodiscard]] model::ModelContents small_beam(model::Form form);

}  // namespace knothe::record::test
