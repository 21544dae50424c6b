#include "knothe/offline/law/element_kernels.hpp"

namespace knothe::offline {

Voigt strain_at(const double* gradient, const CellVector& displacement) {
  // h[i][j] = ∂u_i/∂x_j
  double h[3][3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) {
      double sum = 0;
      for (int a = 0; a < 8; ++a) sum += displacement[8 * i + a] * gradient[8 * j + a];
      h[i][j] = sum;
    }
  return {h[0][0], h[1][1], h[2][2], h[0][1] + h[1][0], h[1][2] + h[2][1], h[2][0] + h[0][2]};
}

void add_internal_force(const double* gradient, const Voigt& stress, double weight, CellVector& vector) {
  const double s[3][3] = {{weight * stress[0], weight * stress[3], weight * stress[5]},
                          {weight * stress[3], weight * stress[1], weight * stress[4]},
                          {weight * stress[5], weight * stress[4], weight * stress[2]}};
  for (int i = 0; i < 3; ++i)
    for (int a = 0; a < 8; ++a)
      vector[8 * i + a] += s[i][0] * gradient[a] + s[i][1] * gradient[8 + a] + s[i][2] * gradient[16 + a];
}

void add_stiffness(const double* gradient, const VoigtMatrix& material, double weight, CellMatrix& matrix) {
  // Row v of B has nonzeros only where component `component[v][·]` meets derivative `derivative[v][·]`.
  constexpr int k_voigt[3][3] = {{0, 3, 5}, {3, 1, 4}, {5, 4, 2}};  // [displacement component][derivative]
  double db[6][k_cell_dofs];                                        // D B
  for (int v = 0; v < 6; ++v)
    for (int k = 0; k < 3; ++k) {
      const double d0 = weight * material[6 * v + k_voigt[k][0]];
      const double d1 = weight * material[6 * v + k_voigt[k][1]];
      const double d2 = weight * material[6 * v + k_voigt[k][2]];
      for (int b = 0; b < 8; ++b)
        db[v][8 * k + b] = d0 * gradient[b] + d1 * gradient[8 + b] + d2 * gradient[16 + b];
    }
  for (int i = 0; i < 3; ++i)
    for (int a = 0; a < 8; ++a) {
      const double g0 = gradient[a], g1 = gradient[8 + a], g2 = gradient[16 + a];
      const double *r0 = db[k_voigt[i][0]], *r1 = db[k_voigt[i][1]], *r2 = db[k_voigt[i][2]];
      double* row = &matrix[(8 * i + a) * k_cell_dofs];
      for (int b = 0; b < k_cell_dofs; ++b) row[b] += g0 * r0[b] + g1 * r1[b] + g2 * r2[b];
    }
}

VoigtMatrix elastic_matrix(const ElasticConstants& elastic) {
  VoigtMatrix c{};
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) c[6 * i + j] = elastic.lambda() + (i == j ? 2 * elastic.mu() : 0.0);
    c[6 * (i + 3) + i + 3] = elastic.mu();
  }
  return c;
}

}  // namespace knothe::offline
