// SPDX-License-Identifier: Apache-2.0
#include "server/composite/avatar_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "proto/base/check.h"
#include "server/composite/mix.h"

namespace mixstage {
namespace {

constexpr int kSpacing = 2;    // of the surface's grid, in values of his depth
constexpr int kContinued = 3;  // values that it goes on beyond his outline: the matte ends him
constexpr int kMargin_px = 8;  // of the box around him
// Parts of him that lie so far behind each other stay one surface: looked at from aside, what no camera saw
// between them is a stretched stripe instead of a hole that the room shows through.
constexpr float kStep_m = 1;
// Shoes on the floor, a hand on the table: what carries him lies before the far side of his outline.
constexpr float kTouching_m = 0.08f;
constexpr std::uint8_t kOwnColor = 250;  // coverage from which on a pixel's colour is his alone
constexpr int kColorReach = 2;           // half-size pixels
constexpr float kLeastScale = 0.6f;      // pixels of the view for one of the texture

int HalfUp(int size) { return (size + 1) / 2; }

}  // namespace

Result<AvatarView> AvatarView::Create(const PinholeCamera& color, const PinholeCamera& view,
                                      const RenderDevice& device) {
  if (auto ok = color.Validate(); !ok) return Within("avatar: the actor's camera", ok.error());
  auto rasteriser = CreateRasteriser(device.backend, view, {}, device.gpu);
  if (!rasteriser) return Within("avatar: the target's camera", rasteriser.error());
  return AvatarView(color, view, std::move(*rasteriser));
}

AvatarView::AvatarView(const PinholeCamera& color, const PinholeCamera& view,
                       std::unique_ptr<Rasteriser> rasteriser)
    : color_(color),
      view_(view),
      half_rays_(HalfUp(color.height), HalfUp(color.width)),
      view_rays_(UnprojectionTable(view)),
      rasteriser_(std::move(rasteriser)) {
  const auto narrow = [](double v) { return static_cast<float>(v); };
  lens_ = {narrow(color.fx), narrow(color.fy), narrow(color.cx), narrow(color.cy),
           narrow(color.k1), narrow(color.k2), narrow(color.k3), narrow(color.k4),
           narrow(color.k5), narrow(color.k6), narrow(color.p1), narrow(color.p2)};
  // The picture's outermost values stand for what reaches a little beyond its border.
  const auto center = [](int i, int count, int size) {
    return i == 0 ? -1.0 : i == count - 1 ? double(size) : 2 * i + 0.5;
  };
  for (int y = 0; y < half_rays_.rows; ++y) {
    for (int x = 0; x < half_rays_.cols; ++x) {
      const auto ray = color.Unproject(
          {center(x, half_rays_.cols, color.width), center(y, half_rays_.rows, color.height)});
      half_rays_(y, x) = ray ? cv::Vec2f(narrow(ray->x()), narrow(ray->y()))
                             : cv::Vec2f::all(std::numeric_limits<float>::quiet_NaN());
    }
  }
}

bool AvatarView::FindBox(const AvatarInput& in) {
  int left = color_.width, right = -1, top = -1, bottom = -1;
  for (int y = 0; y < color_.height; ++y) {
    const std::uint8_t* row = in.alpha.row(y);
    const std::uint8_t* end = row + color_.width;
    const std::uint8_t* first = std::find_if(row, end, [](std::uint8_t a) { return a != 0; });
    if (first == end) continue;
    if (top < 0) top = y;
    bottom = y;
    left = std::min(left, static_cast<int>(first - row));
    const std::uint8_t* last = end - 1;
    while (*last == 0) --last;
    right = std::max(right, static_cast<int>(last - row));
  }
  if (top < 0) return false;
  left = std::max(left - kMargin_px, 0) & ~1;
  top = std::max(top - kMargin_px, 0) & ~1;
  box_ = cv::Rect(left, top, std::min(right + kMargin_px + 1, color_.width) - left,
                  std::min(bottom + kMargin_px + 1, color_.height) - top);
  return true;
}

void AvatarView::ContinueDepth(ImageView<const float> depth_m) {
  const cv::Rect half(box_.x / 2, box_.y / 2, HalfUp(box_.width), HalfUp(box_.height));
  depth_.create(half.size());
  for (int y = 0; y < half.height; ++y) {
    const float* from = depth_m.row(half.y + y) + half.x;
    std::copy(from, from + half.width, depth_[y]);
  }
  for (int i = 0; i < kContinued; ++i) {
    cv::dilate(depth_, scratch_, cv::Mat());
    cv::copyTo(depth_, scratch_, depth_ > 0);
    std::swap(depth_, scratch_);
  }
}

void AvatarView::BuildMesh() {
  positions_.clear();
  indices_.clear();
  const int left = box_.x / 2, top = box_.y / 2;
  vertex_.create((depth_.rows + kSpacing - 2) / kSpacing + 1, (depth_.cols + kSpacing - 2) / kSpacing + 1);
  for (int row = 0; row < vertex_.rows; ++row) {
    const int y = std::min(kSpacing * row, depth_.rows - 1);
    for (int column = 0; column < vertex_.cols; ++column) {
      const int x = std::min(kSpacing * column, depth_.cols - 1);
      const float z = depth_(y, x);
      const cv::Vec2f& ray = half_rays_(top + y, left + x);
      const bool known = z > 0 && ray[0] == ray[0];
      vertex_(row, column) = known ? static_cast<int>(positions_.size()) : -1;
      if (known) positions_.emplace_back(z * ray[0], z * ray[1], z);
    }
  }
  const auto add = [this](int a, int b, int c) {
    if (a < 0 || b < 0 || c < 0) return false;
    const auto z = [this](int v) { return positions_[static_cast<std::size_t>(v)].z(); };
    const auto [near, far] = std::minmax({z(a), z(b), z(c)});
    if (far - near > kStep_m) return false;
    for (const int v : {a, b, c}) indices_.push_back(static_cast<std::uint32_t>(v));
    return true;
  };
  for (int row = 0; row + 1 < vertex_.rows; ++row) {
    for (int column = 0; column + 1 < vertex_.cols; ++column) {
      const int a = vertex_(row, column), b = vertex_(row + 1, column), c = vertex_(row + 1, column + 1),
                d = vertex_(row, column + 1);
      const bool one = add(a, b, c), two = add(a, c, d);
      if (!one && !two && !add(a, b, d)) add(b, c, d);
    }
  }
}

void AvatarView::PrepareTexture(const AvatarInput& in) {
  const YuvImage part = Crop(*in.color, box_);
  alpha_.create(box_.size());
  for (int y = 0; y < box_.height; ++y) {
    const std::uint8_t* from = in.alpha.row(box_.y + y) + box_.x;
    std::copy(from, from + box_.width, alpha_[y]);
  }
  part.y.copyTo(y_);
  // Siting of JPEG: a chroma sample is the middle of its luma pixels, as cv::resize has it. An odd last
  // column or row of luma has chroma of its own.
  const cv::Size whole(part.cb.cols << ChromaShiftX(part.layout), part.cb.rows << ChromaShiftY(part.layout));
  for (const auto& [from, to] : {std::pair(&part.cb, &cb_), std::pair(&part.cr, &cr_)}) {
    cv::Mat1b full;
    cv::resize(*from, full, whole, 0, 0, cv::INTER_LINEAR);
    full(cv::Rect({}, box_.size())).copyTo(*to);
  }
  if (in.foreground != nullptr) TakeOwnColors(*in.foreground);
  ContinueColors(in.foreground != nullptr ? 1 : kOwnColor);

  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3f& p : positions_) middle += p.cast<double>();
  middle /= static_cast<double>(positions_.size());
  const double seen_from = (in.T_view_color * middle).z();
  double scale = seen_from > 0 ? view_.fx / color_.fx * middle.z() / seen_from : 1;
  for (halvings_ = 0; scale < double{kLeastScale} && std::min(y_.cols, y_.rows) >= 4;
       ++halvings_, scale *= 2) {
    for (cv::Mat1b* plane : {&alpha_, &y_, &cb_, &cr_}) {
      cv::Mat1b half;
      cv::resize(*plane, half, {HalfUp(plane->cols), HalfUp(plane->rows)}, 0, 0, cv::INTER_AREA);
      *plane = half;
    }
  }
}

// Where coverage is less than `own` the mean of the colours within reach that are his; elsewhere as they are.
void AvatarView::ContinueColors(std::uint8_t own) {
  const cv::Size half(HalfUp(box_.width), HalfUp(box_.height));
  sums_.create(half);  // Y', Cb, Cr, how many
  for (int v = 0; v < half.height; ++v) {
    for (int u = 0; u < half.width; ++u) {
      cv::Vec4f sum = cv::Vec4f::all(0);
      for (int y = 2 * v; y < std::min(2 * v + 2, box_.height); ++y) {
        for (int x = 2 * u; x < std::min(2 * u + 2, box_.width); ++x) {
          if (alpha_(y, x) >= own) sum += cv::Vec4f(y_(y, x), cb_(y, x), cr_(y, x), 1);
        }
      }
      sums_(v, u) = sum;
    }
  }
  cv::boxFilter(sums_, sums_, -1, {2 * kColorReach + 1, 2 * kColorReach + 1}, {-1, -1}, false,
                cv::BORDER_CONSTANT);
  for (int y = 0; y < box_.height; ++y) {
    const cv::Vec4f* sums = sums_[y / 2];
    for (int x = 0; x < box_.width; ++x) {
      const cv::Vec4f& sum = sums[x / 2];
      if (alpha_(y, x) >= own || sum[3] < 0.5f) continue;
      y_(y, x) = static_cast<std::uint8_t>(sum[0] / sum[3] + 0.5f);
      cb_(y, x) = static_cast<std::uint8_t>(sum[1] / sum[3] + 0.5f);
      cr_(y, x) = static_cast<std::uint8_t>(sum[2] / sum[3] + 0.5f);
    }
  }
}

void AvatarView::TakeOwnColors(const cv::Mat3b& foreground) {
  for (int y = 0; y < box_.height; ++y) {
    const cv::Vec3b* own = foreground[box_.y + y] + box_.x;
    for (int x = 0; x < box_.width; ++x) {
      const std::uint8_t covered = alpha_(y, x);
      if (covered == 0 || covered == 255) continue;
      const Ycbcr8 color = FixedRgbToYcbcr({own[x][0], own[x][1], own[x][2]});
      y_(y, x) = color.y;
      cb_(y, x) = color.cb;
      cr_(y, x) = color.cr;
    }
  }
}

void AvatarView::Run(const AvatarInput& in, const Backdrop& backdrop, AvatarPicture& out) {
  const int w = view_.width, h = view_.height;
  MIX_CHECK(in.color != nullptr && in.color->width() == color_.width && in.color->height() == color_.height);
  MIX_CHECK(in.alpha.width() == color_.width && in.alpha.height() == color_.height);
  MIX_CHECK(in.actor_depth_m.width() == half_rays_.cols && in.actor_depth_m.height() == half_rays_.rows);
  MIX_CHECK(in.foreground == nullptr || in.foreground->size() == cv::Size(color_.width, color_.height));
  MIX_CHECK(backdrop.picture != nullptr && backdrop.picture->width() == w && backdrop.picture->height() == h);
  MIX_CHECK(backdrop.depth == nullptr || backdrop.depth->depth_m.size() == cv::Size(w, h));
  out.picture.Create(w, h, backdrop.picture->layout);
  backdrop.picture->y.copyTo(out.picture.y);
  backdrop.picture->cb.copyTo(out.picture.cb);
  backdrop.picture->cr.copyTo(out.picture.cr);
  out.alpha.create(h, w);
  out.foreground.create(h, w);
  out.alpha.setTo(0);
  out.actor_depth_m.create(HalfUp(h), HalfUp(w));
  out.actor_depth_m.setTo(0);
  if (!FindBox(in)) return;
  ContinueDepth(in.actor_depth_m);
  BuildMesh();
  if (indices_.empty()) return;
  rasteriser_->Begin({});
  rasteriser_->DrawDepth({.positions = positions_, .indices = indices_},
                         Eigen::Affine3d(in.T_view_color.matrix()), Faces::kBoth);
  visible_ = &rasteriser_->Finish();
  drawn_ = visible_->touched & cv::Rect(0, 0, w, h);
  if (drawn_.empty()) return;
  // Whole blocks of chroma and of the half-size depth.
  const cv::Point end(std::min((drawn_.br().x + 1) & ~1, w), std::min((drawn_.br().y + 1) & ~1, h));
  drawn_ = cv::Rect(cv::Point(drawn_.x & ~1, drawn_.y & ~1), end);
  PrepareTexture(in);
  const RigidTransform T_color_view = in.T_view_color.inverse();
  R_color_view_ = T_color_view.linear().cast<float>();
  t_color_view_ = T_color_view.translation().cast<float>();
  texture_s_.resize(static_cast<std::size_t>(w));
  texture_t_.resize(static_cast<std::size_t>(w));
  seen_cb_.create(h, w);
  seen_cr_.create(h, w);
  for (int y = drawn_.y; y < drawn_.br().y; ++y) DrawRow(backdrop, y, out);
  MixChroma(out);
}

void AvatarView::DrawRow(const Backdrop& backdrop, int y, AvatarPicture& out) {
  const YuvImage& picture = *backdrop.picture;
  const int shift_x = ChromaShiftX(picture.layout);
  const std::uint8_t* back_y = picture.y[y];
  const std::uint8_t* back_cb = picture.cb[y >> ChromaShiftY(picture.layout)];
  const std::uint8_t* back_cr = picture.cr[y >> ChromaShiftY(picture.layout)];
  const float* room_z = backdrop.depth != nullptr ? backdrop.depth->depth_m[y] : nullptr;
  const float* room_sigma = backdrop.depth != nullptr ? backdrop.depth->sigma_m[y] : nullptr;
  const float* depth = visible_->depth_m[y];
  const cv::Vec2f* rays = view_rays_[y];
  float* half_depth = out.actor_depth_m[y / 2];
  std::uint8_t* row_cb = seen_cb_[y];
  std::uint8_t* row_cr = seen_cr_[y];
  const SrgbTables& srgb = SrgbTables::Get();
  // Texture coordinates of a pixel of his picture.
  const float scale_x = static_cast<float>(y_.cols) / static_cast<float>(box_.width);
  const float scale_y = static_cast<float>(y_.rows) / static_cast<float>(box_.height);
  const auto last_x = static_cast<float>(y_.cols - 1), last_y = static_cast<float>(y_.rows - 1);

  // Where in the texture the surface of each pixel lies: PinholeCamera::Project; his own pixels have no fold.
  float* to_s = texture_s_.data();
  float* to_t = texture_t_.data();
  const Eigen::Matrix3f& R = R_color_view_;
  const Eigen::Vector3f& shift = t_color_view_;
  const auto box_x = static_cast<float>(box_.x), box_y = static_cast<float>(box_.y);
  for (int x = drawn_.x; x < drawn_.br().x; ++x) {
    const float z = depth[x], a = z * rays[x][0], b = z * rays[x][1];
    const float inverse = 1 / (R(2, 0) * a + R(2, 1) * b + R(2, 2) * z + shift[2]);
    const float nx = inverse * (R(0, 0) * a + R(0, 1) * b + R(0, 2) * z + shift[0]);
    const float ny = inverse * (R(1, 0) * a + R(1, 1) * b + R(1, 2) * z + shift[1]);
    const float r2 = nx * nx + ny * ny;
    const float g = (1 + r2 * (lens_.k1 + r2 * (lens_.k2 + r2 * lens_.k3))) /
                    (1 + r2 * (lens_.k4 + r2 * (lens_.k5 + r2 * lens_.k6)));
    const float two_xy = 2 * nx * ny;
    const float u = lens_.fx * (nx * g + lens_.p1 * two_xy + lens_.p2 * (r2 + 2 * nx * nx)) + lens_.cx;
    const float v = lens_.fy * (ny * g + lens_.p1 * (r2 + 2 * ny * ny) + lens_.p2 * two_xy) + lens_.cy;
    to_s[x] = (u - box_x + 0.5f) * scale_x - 0.5f;
    to_t[x] = (v - box_y + 0.5f) * scale_y - 0.5f;
  }

  for (int x = drawn_.x; x < drawn_.br().x; ++x) {
    std::uint8_t& cb = row_cb[x];
    std::uint8_t& cr = row_cr[x];
    cb = back_cb[x >> shift_x];
    cr = back_cr[x >> shift_x];
    const float z = depth[x];
    if (!(z > 0)) continue;
    // NaN: at his camera's own place.
    const float s = to_s[x] > 0 ? std::min(to_s[x], last_x) : 0;
    const float t = to_t[x] > 0 ? std::min(to_t[x], last_y) : 0;
    const int left = static_cast<int>(s), top = static_cast<int>(t);
    const int right = std::min(left + 1, y_.cols - 1), below = std::min(top + 1, y_.rows - 1);
    const float part_x = s - static_cast<float>(left), part_y = t - static_cast<float>(top);
    const auto sample = [&](const cv::Mat1b& plane) {
      const std::uint8_t* a = plane[top];
      const std::uint8_t* b = plane[below];
      const float upper = static_cast<float>(a[left]) + part_x * static_cast<float>(a[right] - a[left]);
      const float lower = static_cast<float>(b[left]) + part_x * static_cast<float>(b[right] - b[left]);
      return static_cast<int>(upper + part_y * (lower - upper) + 0.5f);
    };
    const int covered = sample(alpha_);
    if (covered == 0) continue;
    if (covered >= 128) {
      float& near = half_depth[x / 2];
      if (near == 0 || z < near) near = z;
    }
    if (room_z != nullptr && room_z[x] > 0 &&
        room_z[x] + ZKey::kRoomSigmas * room_sigma[x] + kTouching_m < z) {
      continue;
    }
    out.alpha(y, x) = static_cast<std::uint8_t>(covered);
    Ycbcr8 seen = {static_cast<std::uint8_t>(sample(y_)), static_cast<std::uint8_t>(sample(cb_)),
                   static_cast<std::uint8_t>(sample(cr_))};
    if (covered < 255) {
      const Rgb8 his = FixedYcbcrToRgb(seen.y, seen.cb, seen.cr);
      out.foreground(y, x) = {his.r, his.g, his.b};
      const Rgb8 back = FixedYcbcrToRgb(back_y[x], cb, cr);
      const float share = static_cast<float>(covered) * (1 / 255.0f);
      const auto mix = [&](std::uint8_t a, std::uint8_t b) {
        return share * srgb.ToLinear(a) + (1 - share) * srgb.ToLinear(b);
      };
      seen = LinearToYcbcr(srgb, mix(his.r, back.r), mix(his.g, back.g), mix(his.b, back.b));
    }
    out.picture.y(y, x) = seen.y;
    cb = seen.cb;
    cr = seen.cr;
  }
}

// A chroma sample is the mean over its luma pixels; where he is not it stays as it was.
void AvatarView::MixChroma(AvatarPicture& out) const {
  const int block_w = 1 << ChromaShiftX(out.picture.layout), block_h = 1 << ChromaShiftY(out.picture.layout);
  for (int y = drawn_.y; y < drawn_.br().y; y += block_h) {
    const int below = std::min(y + block_h, view_.height) - 1;
    for (int x = drawn_.x; x < drawn_.br().x; x += block_w) {
      const int right = std::min(x + block_w, view_.width) - 1;
      if ((out.alpha(y, x) | out.alpha(y, right) | out.alpha(below, x) | out.alpha(below, right)) == 0)
        continue;
      const auto mean = [&](const cv::Mat1b& plane) {
        return static_cast<std::uint8_t>(
            (plane(y, x) + plane(y, right) + plane(below, x) + plane(below, right) + 2) / 4);
      };
      out.picture.cb(y / block_h, x / block_w) = mean(seen_cb_);
      out.picture.cr(y / block_h, x / block_w) = mean(seen_cr_);
    }
  }
}

}  // namespace mixstage
