#include "knothe/reduction/parameter_order.hpp"

#include <algorithm>
#include <cassert>

namespace knothe::reduction {
namespace {

/// values[k, i₁ … i_d] with the axes i permuted: new axis a is old axis order[a].
std::vector<double> permute(const std::vector<double>& values, std::size_t count,
                            const files::Shape& old_shape, const std::vector<std::size_t>& order) {
  const std::size_t d = old_shape.size();
  std::vector<std::size_t> old_stride(d, 1);
  for (std::size_t a = d - 1; a > 0; --a) old_stride[a - 1] = old_stride[a] * old_shape[a];
  const std::size_t block = old_stride[0] * old_shape[0];
  std::vector<double> result;
  result.reserve(values.size());
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<std::size_t> index(d, 0);
    for (std::size_t n = 0; n < block; ++n) {
      std::size_t from = k * block;
      for (std::size_t a = 0; a < d; ++a) from += index[a] * old_stride[order[a]];
      result.push_back(values[from]);
      for (std::size_t a = d; a-- > 0;) {
        if (++index[a] < old_shape[order[a]]) break;
        index[a] = 0;
      }
    }
  }
  return result;
}

template <class T>
std::vector<T> reorder(const std::vector<T>& items, const std::vector<std::size_t>& order) {
  std::vector<T> result;
  for (std::size_t from : order) result.push_back(items[from]);
  return result;
}

}  // namespace

ModelContents with_parameter_order(ModelContents contents, const std::vector<std::string>& names) {
  assert(names.size() == contents.axes.size());
  std::vector<std::size_t> order;
  for (const std::string& name : names) {
    const auto it = std::find_if(contents.axes.begin(), contents.axes.end(),
                                 [&](const Axis& a) { return a.name == name; });
    assert(it != contents.axes.end());
    order.push_back(static_cast<std::size_t>(it - contents.axes.begin()));
  }
  if (std::is_sorted(order.begin(), order.end())) return contents;
  const files::Shape old_shape = contents.grid_shape();
  contents.axes = reorder(contents.axes, order);
  if (contents.form == Form::canonical) contents.parameters = reorder(contents.parameters, order);
  if (!contents.joint.empty())
    contents.joint = permute(contents.joint, contents.parameter_modes, old_shape, order);
  for (ModelOutput& output : contents.outputs)
    output.joint = permute(output.joint, output.modes, old_shape, order);
  return contents;
}

}  // namespace knothe::reduction
