#pragma once
/// @file The reduced model's content and its file (docs/reference/formats.md). No Eigen types: see
/// snapshots.hpp.
#include <string>
#include <vector>

#include "knothe/model/compress/snapshots.hpp"

namespace knothe::model {

/// How u − lift is separated.
enum class Form {
  canonical,  ///< Σ_k Λ_k(x) λ_k(t) Π_i α_k^i(p_i)            (Rubio et al. 2019, Eq. 12)
  tree        ///< Σ_l Σ_k U_l(x) c_lk(t) β_k(p)              (x,t) separated from p
};

/// "canonical" or "tree".
[[nodiscard]] std::string to_text(Form form);

/// Elastic solutions for a unit displacement with a crack of each length: u = Σ_k coefficients_ik modes_k.
struct CrackSolutions {
  std::vector<double> length;        ///< [n], metres
  std::vector<double> modes;         ///< [s, n_dof], per metre of prescribed displacement
  std::vector<double> coefficients;  ///< [n, s]
  [[nodiscard]] bool empty() const { return length.empty(); }
};

/// How far a model is from solutions that it was not made from.
struct BetweenNodes {
  double relative_error = 0.0;  ///< ‖u − u_model‖ / ‖u‖
  double max_error_m = 0.0;     ///< largest |u − u_model| on any dof and time
  std::string source;           ///< "full-order solutions", or "left-out nodes", which is an estimate
};

/// Everything in a model file. Arrays in C order.
struct ModelContents {
  Form form = Form::tree;
  std::vector<Axis> axes;
  std::vector<double> time;  ///< [n_t]
  std::string time_units;    ///< empty where the solver states none
  files::Labels field{"m", "displacement"};
  std::size_t space_modes = 0;                  ///< l (canonical: m)
  std::size_t parameter_modes = 0;              ///< r (canonical: m)
  std::vector<double> space;                    ///< [l, n_dof]
  std::vector<double> temporal;                 ///< canonical [m, n_t]; tree [n_t, l, r]
  std::vector<std::vector<double>> parameters;  ///< canonical: one [m, nᵢ] per axis
  std::vector<double> joint;                    ///< tree: [r, n₁, …, n_d]
  std::vector<double> lift;                     ///< [n_t, n_dof]
  Dofs dofs;
  std::vector<Quantity> quantities;  ///< the dofs where they have names instead of places
  std::optional<Mesh> mesh;
  std::vector<SnapshotOutput> outputs;  ///< interpolated on the grid by the same splines
  CrackSolutions crack;
  std::string project;                   ///< the project file's text, or where the snapshots came from
  std::string created_by;                ///< filled when saved
  double relative_error = 0.0;           ///< ‖u − u_model‖ / ‖u‖ over the training grid
  double max_error_m = 0.0;              ///< largest |u − u_model| on any dof, time and training point
  std::optional<BetweenNodes> off_grid;  ///< the same off the grid; empty where it is not known

  [[nodiscard]] files::Shape grid_shape() const;
  [[nodiscard]] std::size_t dof_count() const { return space_modes == 0 ? 0 : space.size() / space_modes; }
};

/// Throws DataError, prefixed by `where`, unless all shapes fit, axes and time increase and all is finite.
void validate(const ModelContents& contents, const std::string& where);

/// Writes atomically. IoError.
void write_model(const ModelContents& contents, const std::string& path);

/// Reads and validates. Missing, truncated, of another schema: DataError that says what to do.
[[nodiscard]] ModelContents read_model(const std::string& path);

/// Writes one field `values` [n_dof] at model time `time` for ParaView (.vtu): the displacement vector on the
/// mesh points. DataError if the model has no mesh or no dofs; IoError.
void write_field(const ModelContents& contents, std::span<const double> values, double time,
                 const std::string& path);

}  // namespace knothe::model
