// SPDX-License-Identifier: Apache-2.0
//
// The light map (MixIn3D 3.2): by how much virtual objects dim what the camera sees, and what dims the
// virtual objects. For every lamp l: V_r, whether it is seen past room and actor, V_v past virtual objects.
// The camera already shows V_r, so a real pixel is scaled by
//   s = (A (1 - occlusion) + sum L_l N.l V_r V_v) / (A + sum L_l N.l V_r)
// and nothing is darkened twice (the papers leave doubled shadows; algorithms 9). Virtual pixels are shaded
// as if nothing stood before any lamp and scaled by
//   s = (A + sum L_l N.l V_r V_v) / (A + sum L_l N.l)
// One pass for both back ends, on this processor.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "proto/base/image_view.h"
#include "proto/geometry/camera_model.h"
#include "proto/geometry/frames.h"
#include "server/environment/environment_folder.h"
#include "server/render/cg_renderer.h"
#include "server/render/illumination.h"
#include "server/render/lamp_samples.h"
#include "server/render/shadow_map.h"
#include "server/render/shadow_shapes.h"
#include "server/render/surfel_table.h"
#include "server/scene/scene.h"

namespace mixstage {

// Pixel (x, y) of a factor's picture stands for the full picture's (2 x, 2 y); R G B in linear light, 0..1.
struct LightMap {
  cv::Mat3f room, actor;  // [Half(h) x Half(w)]
  static constexpr int kTile = 16;
  cv::Rect actor_bounds;          // of actor's factors: 1 outside
  cv::Mat1b touched;              // one a square of kTile factors: 0 = room and actor stay as they are there
  std::uint64_t cg_revision = 0;  // rises whenever the virtual objects' factors, or their picture, change
  cv::Rect cg_bounds;             // the same for virtual objects
  cv::Mat3f cg;                   // [Half(h) x Half(w)]; valid inside cg_bounds
};

struct LightMapInput {
  const Scene* scene = nullptr;
  RigidTransform T_scene_color = RigidTransform::Identity();
  const Illumination* light = nullptr;
  const CgLayer* cg = nullptr;           // drawn of scene from there by light
  std::uint64_t room_revision = 0;       // differs between any two rooms; 0 = its depth is not known
  cv::Mat1f room_depth_m;                // [h x w] z, 0 = not known
  ImageView<const float> actor_depth_m;  // [Half(h) x Half(w)] z of the actor, 0 = not he; may be empty
};

class LightMapper {
 public:
  explicit LightMapper(const PinholeCamera& color);

  // What of the scanned room casts shadows; world frame. room is valid (checked).
  void SetRoom(const RoomModel& room);

  // Valid until the next call. One thread at a time.
  const LightMap& Run(const LightMapInput& in);

 private:
  struct Lamp {
    LampSample sample;
    ShadowMap room, actor, cg;
    bool room_drawn = false;
  };
  struct Object {
    std::shared_ptr<const Mesh> mesh;
    std::shared_ptr<const PosedVertices> posed;  // null: the mesh's own
    std::shared_ptr<const ShadowShape> shape;
    Eigen::Affine3d T_scene_object = Eigen::Affine3d::Identity();
    Eigen::Vector3f center = Eigen::Vector3f::Zero();
    float radius_m = 0;
    SurfelTable::Range surfels;
  };
  struct Point {
    Eigen::Vector3f position, normal;
  };
  struct Found {
    int x, y;
    Point at;
  };
  struct Sphere {
    Eigen::Vector3f center = Eigen::Vector3f::Zero();
    float radius_m = -1;  // < 0: nothing is there
  };
  using Lamps = std::vector<std::uint8_t>;  // one a lamp: 0 = does not matter
  // A pixel of the factors that is not 1, as everything but the actor leaves it. Light is received x the
  // lamp's strength.
  struct Spot {
    int x = 0, y = 0, size = 1;
    Eigen::Vector3f position = Eigen::Vector3f::Zero();
    Eigen::Vector3f seen = Eigen::Vector3f::Zero();  // what the factor counts from, beside the lamps' light
    Eigen::Vector3f ambient = Eigen::Vector3f::Zero();  // what is left of the ambient light
    cv::Vec3f factor;
  };
  // A square of factors with its spots.
  struct Tile {
    cv::Rect box;
    std::vector<Spot> spots;
    std::vector<float> seen, kept;  // [spot][lamp]: received of what the factor counts from, and what is left
    Eigen::Vector3f center = Eigen::Vector3f::Zero();  // of a sphere around them
    float radius_m = 0;
    bool dimmed = false;  // by the actor, in the last frame
  };

  void PlaceLamps(const LightMapInput& in);
  std::shared_ptr<const ShadowShape> ShapeOf(const SceneObject& object);
  // Also says where objects have been and are that moved: moved_; nothing where others are there now.
  void PlaceObjects(const Scene& scene);
  void Touch(const cv::Rect& tile, cv::Mat1b& touched) const;
  [[nodiscard]] bool SameObjects(const Scene& scene) const;
  void PlaceActor(const LightMapInput& in);
  void DrawRoomMaps(std::size_t most);
  enum class Renew { kAll, kMoved, kCoarse };
  void LightRoom(const LightMapInput& in, Renew renew);
  [[nodiscard]] bool MovedReach(const Sphere& points) const;
  void LightActor(const LightMapInput& in);
  void LightCg(const LightMapInput& in);
  // What lies between spots: lit on the room, of which spots are what is not; an edge's neighbours on CG.
  enum class Beside { kLit, kUnknown };
  // factor: of each of the tile's spots.
  static void Fill(const Tile& tile, const std::vector<cv::Vec3f>& factor, Beside beside, cv::Mat3f& factors);
  // Spots that are dimmed by less than is seen.
  void DropUnseen(Tile& tile) const;
  // Adds a tile whose spots are there; one without any is dropped.
  void Close(Tile tile, std::vector<Tile>& to, Beside beside, cv::Mat3f& factors);
  [[nodiscard]] cv::Vec3f FactorOf(const Tile& tile, std::size_t spot, const float* actor_lit) const;
  // What the actor changes; false: nothing, now and in the frame before.
  bool Shade(std::vector<Tile>& tiles, Beside beside, cv::Mat3f& factors);
  // Whether a sphere of points may lie in some shadow; fills shaded_ and hiding_.
  bool MayBeShaded(const Eigen::Vector3f& center, float radius_m);
  // By the objects that hiding_ names.
  [[nodiscard]] float HiddenAmbient(const Point& at) const;
  // Nothing where no point of it may be shaded; shaded_ and hiding_ say by what.
  template <typename Depth>
  std::optional<Tile> TileAt(const Depth& depth, int x0, int y0);
  template <typename Depth>
  [[nodiscard]] Sphere SphereOf(const Depth& depth, const cv::Rect& tile) const;
  template <typename Depth>
  std::optional<Point> PointAt(const Depth& depth, int x, int y) const;
  // Every step-th point of a square there is: found_.
  template <typename Depth>
  void FindPoints(const Depth& depth, const cv::Rect& box, int step);
  // found_ above their surface: points_.
  void Raise(float by_m);
  // What a map of every lamp that matters (none named: of all) leaves of it at points_.
  void ShareOf(ShadowMap Lamp::*map, float bias_m, const Lamps* matter, std::vector<float>& share);

  PinholeCamera color_;
  cv::Size half_;
  cv::Mat2f rays_;  // [Half(h) x Half(w)] of the full picture's even pixels
  ShadowShape room_shape_;
  ShadowRasteriser rasteriser_;
  std::map<std::shared_ptr<const Mesh>, std::shared_ptr<const ShadowShape>> shapes_;  // of objects_
  std::vector<Object> objects_;
  SurfelTable surfels_;  // of all objects, scene frame
  std::vector<Lamp> lamps_;
  Illumination light_;
  std::uint64_t lamps_revision_ = 0, objects_revision_ = 0, room_maps_revision_ = 0;
  ActorShape actor_;
  const ShadowShape* actor_shape_ = nullptr;  // null: nobody is there
  Eigen::Matrix3f R_ = Eigen::Matrix3f::Identity();
  Eigen::Vector3f t_ = Eigen::Vector3f::Zero();
  // What the map was made of.
  struct Made {
    std::uint64_t room = 0, lamps = 0, objects = 0, room_maps = 0, drawing = 0;
    RigidTransform T_scene_color = RigidTransform::Identity();
  } made_;
  // Whatever moves is shaded every second pixel; all of them once it stands.
  int step_ = 1;
  LightMap map_;
  std::vector<Tile> room_, cg_;
  std::vector<Tile> room_before_;             // scratch
  std::optional<std::vector<Sphere>> moved_;  // objects of the last change, before and after it
  std::vector<Sphere> room_tiles_;            // around the room's points, of every square
  cv::Mat1b room_touched_, room_coarse_;      // a square: 255 = only every second pixel was shaded
  // Scratch.
  Lamps shaded_;
  std::vector<std::uint8_t> hiding_;  // one an object: 0 = too far away to hide ambient light
  std::vector<Found> found_;
  PointRun points_;
  LitRun lit_;
  std::vector<float> share_, room_share_;  // [point][lamp]
  std::vector<cv::Vec3f> factor_;
};

}  // namespace mixstage
