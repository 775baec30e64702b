// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/lens_jacobian.h"

#include <cmath>

namespace mixstage {
namespace {

template <bool kWithLens>
void Pinhole(const double* n, const Eigen::Vector3d& p, LensJacobian& out) {
  const double iz = 1 / p.z();
  const double x = p.x() * iz;
  const double y = p.y() * iz;
  const double r2 = x * x + y * y;
  const double D = 1 + r2 * (n[9] + r2 * (n[10] + r2 * n[11]));
  const double N = 1 + r2 * (n[4] + r2 * (n[5] + r2 * n[8]));
  const double dN = n[4] + r2 * (2 * n[5] + r2 * 3 * n[8]);
  const double dD = n[9] + r2 * (2 * n[10] + r2 * 3 * n[11]);
  const double g = N / D;
  const double dg = (dN - g * dD) / D;
  const double xd = x * g + 2 * n[6] * x * y + n[7] * (r2 + 2 * x * x);
  const double yd = y * g + n[6] * (r2 + 2 * y * y) + 2 * n[7] * x * y;
  out.pixel << n[0] * xd + n[2], n[1] * yd + n[3];
  const double xx = g + 2 * x * x * dg + 2 * n[6] * y + 6 * n[7] * x;
  const double xy = 2 * x * y * dg + 2 * n[6] * x + 2 * n[7] * y;
  const double yy = g + 2 * y * y * dg + 6 * n[6] * y + 2 * n[7] * x;
  out.by_point << n[0] * xx * iz, n[0] * xy * iz, -n[0] * (xx * x + xy * y) * iz,  //
      n[1] * xy * iz, n[1] * yy * iz, -n[1] * (xy * x + yy * y) * iz;
  if constexpr (kWithLens) {
    const double fx = n[0] * x / D;
    const double fy = n[1] * y / D;
    const double r4 = r2 * r2;
    const double r6 = r4 * r2;
    out.by_lens << xd, 0, 1, 0, fx * r2, fx * r4, n[0] * 2 * x * y, n[0] * (r2 + 2 * x * x), fx * r6,
        -fx * g * r2, -fx * g * r4, -fx * g * r6,  //
        0, yd, 0, 1, fy * r2, fy * r4, n[1] * (r2 + 2 * y * y), n[1] * 2 * x * y, fy * r6, -fy * g * r2,
        -fy * g * r4, -fy * g * r6;
  }
}

template <bool kWithLens>
void Fisheye(const double* n, const Eigen::Vector3d& p, LensJacobian& out) {
  const double rho2 = std::max(p.head<2>().squaredNorm(), 1e-24);
  const double rho = std::sqrt(rho2);
  const double theta = std::atan2(rho, p.z());
  const double t2 = theta * theta;
  const double bent = theta * (1 + t2 * (n[4] + t2 * (n[5] + t2 * (n[6] + t2 * n[7]))));
  const double slope = 1 + t2 * (3 * n[4] + t2 * (5 * n[5] + t2 * (7 * n[6] + t2 * 9 * n[7])));
  const double s = bent / rho;
  out.pixel << n[0] * s * p.x() + n[2], n[1] * s * p.y() + n[3];
  const double length2 = rho2 + p.z() * p.z();
  // s by rho and by z.
  const double s_rho = (slope * p.z() / length2 - s) / rho;
  const double s_z = -slope / length2;
  const double x_rho = p.x() / rho;
  const double y_rho = p.y() / rho;
  out.by_point << n[0] * (s + p.x() * s_rho * x_rho), n[0] * p.x() * s_rho * y_rho, n[0] * p.x() * s_z,  //
      n[1] * p.y() * s_rho * x_rho, n[1] * (s + p.y() * s_rho * y_rho), n[1] * p.y() * s_z;
  if constexpr (kWithLens) {
    out.by_lens.setZero();
    out.by_lens(0, 0) = s * p.x();
    out.by_lens(1, 1) = s * p.y();
    out.by_lens(0, 2) = out.by_lens(1, 3) = 1;
    double power = theta * t2 / rho;
    for (int k = 4; k < 8; ++k, power *= t2) {
      out.by_lens(0, k) = n[0] * p.x() * power;
      out.by_lens(1, k) = n[1] * p.y() * power;
    }
  }
}

}  // namespace

void ProjectWithPoint(LensKind kind, const double* lens, const Eigen::Vector3d& p, LensJacobian& out) {
  kind == LensKind::kPinhole ? Pinhole<false>(lens, p, out) : Fisheye<false>(lens, p, out);
}

void ProjectWithLens(LensKind kind, const double* lens, const Eigen::Vector3d& p, LensJacobian& out) {
  kind == LensKind::kPinhole ? Pinhole<true>(lens, p, out) : Fisheye<true>(lens, p, out);
}

}  // namespace mixstage
