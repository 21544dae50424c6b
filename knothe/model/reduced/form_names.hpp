#pragma once
/// @file Words for the forms of a separated model.
#include <array>

#include "knothe/base/enum_names.hpp"
#include "knothe/model/reduced/model_file.hpp"

namespace knothe::model {

constexpr auto names_of(Form /*form*/) {
  return std::to_array<Named<Form>>({{Form::tree, "tree"}, {Form::canonical, "canonical"}});
}

}  // namespace knothe::model
