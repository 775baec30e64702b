// SPDX-License-Identifier: Apache-2.0
#include "server/physics/physics.h"

#include <BulletCollision/CollisionDispatch/btConvexConvexAlgorithm.h>
#include <BulletCollision/CollisionDispatch/btInternalEdgeUtility.h>
#include <BulletCollision/NarrowPhaseCollision/btGjkEpaPenetrationDepthSolver.h>
#include <btBulletDynamicsCommon.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "proto/base/check.h"
#include "server/physics/body_shape.h"

namespace mixstage {
namespace {

constexpr double kGravity = 9.81;  // m/s^2
constexpr float kStepS = 1.0f / kPhysicsStepsPerSecond;
constexpr std::int64_t kMostSteps = kPhysicsStepsPerSecond / 4;
constexpr std::int64_t kDragSteps = kPhysicsStepsPerSecond / 4;
constexpr std::int64_t kApartSteps = kPhysicsStepsPerSecond / 20;  // a contact that ends for less goes on
constexpr double kLiftM = 0.05;                                    // a sunken object is lifted so far
constexpr double kTouchM = 0.001;
constexpr double kFallenM = 20;        // below the scene's origin: it has left the room
constexpr float kFastest = 20.0f;      // m/s
constexpr float kFastestTurn = 60.0f;  // rad/s
constexpr float kActorFriction = 0.8f;
// What has not left these bounds for so long is at rest, however it trembles.
constexpr double kRestM = 0.003, kRestRad = 0.03;
constexpr std::int64_t kRestSteps = kPhysicsStepsPerSecond / 2;
// A body that is awake trembles; what moves it by less than this nobody sees, and nothing is drawn anew.
constexpr double kSeenM = 0.0003, kSeenRad = 0.001;
constexpr std::size_t kMostEvents = 256;
constexpr double kReachM = 0.5;

enum Group : int {
  kRoomGroup = 1,
  kIsolatedGroup = 2,
  kMutualGroup = 4,
  kActorsObject = 8,
  kActorGroup = 16
};
constexpr int kObjects = kMutualGroup | kActorsObject;

struct Filter {
  int group = 0, mask = 0;
};
Filter FilterOf(Body body) {
  switch (body) {
    case Body::kIsolated:
      return {kIsolatedGroup, kRoomGroup};
    case Body::kMutual:
      return {kMutualGroup, kRoomGroup | kObjects};
    case Body::kActor:
      break;
  }
  return {kActorsObject, kRoomGroup | kObjects | kActorGroup};
}

// Who a Bullet object is, as its user index: an object's id, or one of these.
constexpr int kFloorIndex = -1, kRoomIndex = -2, kActorIndex = -3;

btVector3 ToBullet(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}
Eigen::Vector3d FromBullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }

btTransform ToBullet(const Eigen::Isometry3d& T) {
  const Eigen::Quaterniond q(T.linear());
  return btTransform(btQuaternion(static_cast<float>(q.x()), static_cast<float>(q.y()),
                                  static_cast<float>(q.z()), static_cast<float>(q.w())),
                     ToBullet(Eigen::Vector3d(T.translation())));
}
Eigen::Isometry3d FromBullet(const btTransform& T) {
  const btQuaternion q = T.getRotation();
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  out.linear() = Eigen::Quaterniond(q.w(), q.x(), q.y(), q.z()).normalized().toRotationMatrix();
  out.translation() = FromBullet(T.getOrigin());
  return out;
}

// A body that slides over the room's triangles would catch on the edges between them: contacts there take the
// direction of the surface.
bool AdjustRoomContact(btManifoldPoint& point, const btCollisionObjectWrapper* a, int part_a, int index_a,
                       const btCollisionObjectWrapper* b, int part_b, int index_b) {
  // Does nothing unless its first is a triangle.
  btAdjustInternalEdgeContacts(point, b, a, part_b, index_b);
  btAdjustInternalEdgeContacts(point, a, b, part_a, index_a);
  return true;
}

// The deepest place in which a body stands in the room.
struct Deepest : btCollisionWorld::ContactResultCallback {
  const btCollisionObject* body = nullptr;
  double depth_m = 0;
  Eigen::Vector3d out = Eigen::Vector3d::Zero();  // toward the body
  btScalar addSingleResult(btManifoldPoint& point, const btCollisionObjectWrapper* a, int, int,
                           const btCollisionObjectWrapper*, int, int) override {
    const double depth = -static_cast<double>(point.getDistance());
    if (depth <= depth_m) return 0;
    depth_m = depth;
    const double sign = a->getCollisionObject() == body ? 1 : -1;
    out = sign * FromBullet(point.m_normalWorldOnB);
    return 0;
  }
};

struct Inside : btCollisionWorld::ContactResultCallback {
  bool any = false;
  btScalar addSingleResult(btManifoldPoint& point, const btCollisionObjectWrapper*, int, int,
                           const btCollisionObjectWrapper*, int, int) override {
    any = any || point.getDistance() < 0;
    return 0;
  }
};

bool IsSeenToMove(const Eigen::Affine3d& before, const Eigen::Affine3d& after) {
  return (after.translation() - before.translation()).norm() > kSeenM ||
         (after.linear() - before.linear()).norm() > kSeenRad * before.linear().norm();
}

}  // namespace

const char* PhysicsEventName(PhysicsEventKind kind) {
  constexpr const char* kNames[] = {"touch", "rest", "problem", "message"};
  return kNames[static_cast<int>(kind) - 1];
}

struct Physics::State {
  struct Object {
    std::string name;
    std::uint64_t put = 0;
    Body kind = Body::kMutual;
    bool drop = false, hidden = false;
    double mass_kg = 1, friction = 0.5, restitution = 0;
    std::shared_ptr<const Mesh> mesh;
    Eigen::Affine3d T_put = Eigen::Affine3d::Identity();  // where a person put it
    Eigen::Affine3d T_now = Eigen::Affine3d::Identity();
    Eigen::Matrix3d stretch = Eigen::Matrix3d::Zero();
    std::shared_ptr<const BodyShape> shape;
    std::unique_ptr<btRigidBody> body;  // null: not in the world
    bool free = false;                  // moved by Bullet
    std::optional<std::int64_t> free_at{};
    bool unable = false;   // to fall, from where it was put
    bool resting = false;  // told
    bool asleep = false;   // by us
    btTransform calm_since = btTransform::getIdentity();
    std::int64_t calm_since_step = 0;
  };
  struct Ball {
    std::unique_ptr<btSphereShape> shape;
    std::unique_ptr<btRigidBody> body;
    Eigen::Vector3d from = Eigen::Vector3d::Zero(), to = Eigen::Vector3d::Zero();
    bool solid = false;  // false: it appeared inside an object and has not left it yet
    bool seen = false;
  };

  explicit State(SceneFrame scene_frame)
      : frame(scene_frame),
        up(UpOf(scene_frame)),
        dispatcher(&configuration),
        world(&dispatcher, &broadphase, &solver, &configuration) {
    // A flat foot stands on more than one point of the room. Between objects this costs more than it shows.
    on_triangles.m_numPerturbationIterations = 4;
    on_triangles.m_minimumPointsPerturbationThreshold = 3;
    configuration.setPlaneConvexMultipointIterations(4, 4);
    for (const int shape : {BOX_SHAPE_PROXYTYPE, CUSTOM_CONVEX_SHAPE_TYPE}) {
      dispatcher.registerCollisionCreateFunc(shape, TRIANGLE_SHAPE_PROXYTYPE, &on_triangles);
    }
    world.setGravity(ToBullet(Eigen::Vector3d(-kGravity * up)));
    btContactSolverInfo& info = world.getSolverInfo();
    // What stands too deep is moved out, not thrown out.
    info.m_splitImpulse = 1;
    info.m_splitImpulsePenetrationThreshold = 0;
    info.m_restitutionVelocityThreshold = 0.1f;
    // By default only what moves 4 cm in a step is looked after.
    world.getDispatchInfo().m_allowedCcdPenetration = 0.0005f;
    world.setForceUpdateAllAabbs(false);
    gContactAddedCallback = &AdjustRoomContact;
    if (frame == SceneFrame::kWorld) {
      floor_shape = std::make_unique<btStaticPlaneShape>(ToBullet(up), 0.0f);
      floor_shape->setMargin(0);
      floor = AddStanding(*floor_shape, kFloorIndex);
    }
  }
  ~State() {
    for (auto& [id, ball] : balls) world.removeRigidBody(ball.body.get());
    for (auto& [id, object] : objects) Take(object);
    for (const auto* body : {&floor, &room}) {
      if (*body) world.removeRigidBody(body->get());
    }
  }

  std::unique_ptr<btRigidBody> AddStanding(btCollisionShape& shape, int index) {
    auto body = std::make_unique<btRigidBody>(btRigidBody::btRigidBodyConstructionInfo(0, nullptr, &shape));
    body->setFriction(1);
    body->setRestitution(1);
    body->setUserIndex(index);
    world.addRigidBody(body.get(), kRoomGroup, ~kRoomGroup);
    return body;
  }

  // Out of the world.
  void Take(Object& object) {
    if (!object.body) return;
    world.removeRigidBody(object.body.get());
    object.body.reset();
    object.free = false;
  }
  void Wake(const btRigidBody& near) {
    btVector3 low;
    btVector3 high;
    near.getAabb(low, high);
    const btVector3 slack(0.02f, 0.02f, 0.02f);
    for (auto& [id, object] : objects) {
      if (!object.free) continue;
      btVector3 a;
      btVector3 b;
      object.body->getAabb(a, b);
      if (TestAabbAgainstAabb2(low - slack, high + slack, a, b)) object.body->activate(true);
    }
  }

  [[nodiscard]] std::shared_ptr<const BodyShape> ShapeOf(const Object& object, std::string& why) {
    for (const auto& [id, other] : objects) {
      if (other.shape && other.mesh == object.mesh && other.stretch == object.stretch) return other.shape;
    }
    auto made = MakeBodyShape(*object.mesh, object.stretch);
    if (made) return std::make_shared<const BodyShape>(std::move(*made));
    why = made.error().message;
    return nullptr;
  }

  // Into the world where it was put: standing there, or free.
  void Enter(std::uint32_t id, Object& object, bool free) {
    Take(object);
    const SplitPose split = Split(object.T_put);
    if (!object.shape || object.stretch != split.stretch) {
      object.stretch = split.stretch;
      object.shape.reset();
      std::string why;
      object.shape = ShapeOf(object, why);
      if (!object.shape) {
        object.unable = true;
        if (object.drop) Problem(id, object, why);
        return;
      }
    }
    const BodyShape& shape = *object.shape;
    const auto mass = static_cast<float>(free ? object.mass_kg : 0);
    btRigidBody::btRigidBodyConstructionInfo info(mass, nullptr, shape.shape, mass * shape.inertia_per_kg);
    info.m_friction = static_cast<float>(object.friction);
    info.m_restitution = static_cast<float>(object.restitution);
    info.m_linearDamping = 0;
    info.m_angularDamping = 0.05f;
    // A ball that nothing brakes rolls for ever.
    info.m_rollingFriction = static_cast<float>(0.01 * shape.inner_radius_m);
    info.m_spinningFriction = info.m_rollingFriction;
    info.m_linearSleepingThreshold = 0.02f;
    info.m_angularSleepingThreshold = 0.1f;
    object.body = std::make_unique<btRigidBody>(info);
    btRigidBody& body = *object.body;
    body.setUserIndex(static_cast<int>(id));
    const Eigen::Affine3d T_object_body = shape.T_body_object.inverse();
    Eigen::Isometry3d T_scene_body = Eigen::Isometry3d::Identity();
    T_scene_body.linear() = split.T_scene_stretched.linear();
    T_scene_body.translation() = object.T_put * T_object_body.translation();
    Place(body, ToBullet(T_scene_body));
    if (free) {
      body.setCcdMotionThreshold(static_cast<float>(0.5 * shape.inner_radius_m));
      body.setCcdSweptSphereRadius(static_cast<float>(0.4 * shape.inner_radius_m));
      body.setCollisionFlags(body.getCollisionFlags() | btCollisionObject::CF_CUSTOM_MATERIAL_CALLBACK);
    }
    const Filter filter = FilterOf(object.kind);
    world.addRigidBody(&body, filter.group, filter.mask);
    object.free = free;
    object.resting = object.asleep = false;
    object.calm_since = body.getWorldTransform();
    object.calm_since_step = step;
    Wake(body);
    if (free && !LiftOut(body)) {
      Problem(id, object, "stands in the room's surface: it stays where it was put");
      object.unable = true;
      Enter(id, object, false);
    }
  }

  static void Place(btRigidBody& body, const btTransform& T) {
    body.setWorldTransform(T);
    body.setInterpolationWorldTransform(T);
  }

  // False where the body stands deeper in the room than it may be moved.
  bool LiftOut(btRigidBody& body) {
    const Eigen::Vector3d start = FromBullet(body.getWorldTransform().getOrigin());
    for (int attempt = 0; attempt < 8; ++attempt) {
      Deepest deepest;
      deepest.body = &body;
      deepest.m_collisionFilterGroup = ~0;
      deepest.m_collisionFilterMask = kRoomGroup;
      world.contactTest(&body, deepest);
      if (deepest.depth_m < kTouchM) return true;
      btTransform T = body.getWorldTransform();
      T.setOrigin(T.getOrigin() + ToBullet(Eigen::Vector3d(deepest.depth_m * deepest.out)));
      if ((FromBullet(T.getOrigin()) - start).norm() > kLiftM) return false;
      Place(body, T);
      world.updateSingleAabb(&body);
    }
    return false;
  }

  void Problem(std::uint32_t id, const Object& object, std::string why) {
    Say({.kind = PhysicsEventKind::kProblem,
         .t_us = now_us,
         .object = id,
         .name = object.name,
         .text = object.name + " " + std::move(why)});
  }
  void Say(PhysicsEvent event) {
    if (events.size() < kMostEvents) events.push_back(std::move(event));
  }

  void SetBalls(std::span<const ActorBall> actor) {
    for (auto& [id, ball] : balls) ball.seen = false;
    for (const ActorBall& now : actor) {
      Ball& ball = balls[now.id];
      ball.seen = true;
      if (!ball.body) {
        ball.shape = std::make_unique<btSphereShape>(static_cast<float>(now.radius_m));
        btRigidBody::btRigidBodyConstructionInfo info(0, nullptr, ball.shape.get());
        info.m_friction = kActorFriction;
        ball.body = std::make_unique<btRigidBody>(info);
        ball.body->setUserIndex(kActorIndex);
        ball.body->setCollisionFlags(btCollisionObject::CF_KINEMATIC_OBJECT |
                                     btCollisionObject::CF_NO_CONTACT_RESPONSE);
        ball.body->setActivationState(DISABLE_DEACTIVATION);
        ball.to = now.center;
        Place(*ball.body, btTransform(btQuaternion::getIdentity(), ToBullet(now.center)));
        world.addRigidBody(ball.body.get(), kActorGroup, kActorsObject);
      }
      ball.from = ball.to;
      ball.to = now.center;
      if (!ball.solid) {
        Inside inside;
        inside.m_collisionFilterGroup = ~0;
        inside.m_collisionFilterMask = kActorsObject;
        world.contactTest(ball.body.get(), inside);
        if (!inside.any) {
          ball.solid = true;
          ball.body->setCollisionFlags(btCollisionObject::CF_KINEMATIC_OBJECT);
        }
      }
    }
    for (auto ball = balls.begin(); ball != balls.end();) {
      if (ball->second.seen) {
        ++ball;
        continue;
      }
      Wake(*ball->second.body);
      world.removeRigidBody(ball->second.body.get());
      ball = balls.erase(ball);
    }
  }

  void Step(double share) {
    for (auto& [id, object] : objects) {
      if (object.free_at && step >= *object.free_at) {
        object.free_at.reset();
        Enter(id, object, true);
      }
    }
    for (auto& [id, ball] : balls) {
      ball.body->setWorldTransform(btTransform(
          btQuaternion::getIdentity(), ToBullet(Eigen::Vector3d(ball.from + share * (ball.to - ball.from)))));
    }
    world.stepSimulation(kStepS, 0);
    ++step;
    for (auto& [id, object] : objects) {
      if (object.free) Watch(id, object);
    }
    FindContacts();
  }

  void Watch(std::uint32_t id, Object& object) {
    btRigidBody& body = *object.body;
    const Eigen::Vector3d center = FromBullet(body.getWorldTransform().getOrigin());
    if (!center.allFinite() || up.dot(center) < -kFallenM || center.norm() > 1e4) {
      object.unable = true;
      Problem(id, object, "fell out of the room: it is back where it was put");
      Enter(id, object, false);
      return;
    }
    const float speed = body.getLinearVelocity().length();
    if (speed > kFastest) body.setLinearVelocity(body.getLinearVelocity() * (kFastest / speed));
    const float turn = body.getAngularVelocity().length();
    if (turn > kFastestTurn) body.setAngularVelocity(body.getAngularVelocity() * (kFastestTurn / turn));
    const btTransform& T = body.getWorldTransform();
    const btTransform& since = object.calm_since;
    if (static_cast<double>((T.getOrigin() - since.getOrigin()).length()) > kRestM ||
        static_cast<double>(T.getRotation().angleShortestPath(since.getRotation())) > kRestRad) {
      object.calm_since = T;
      object.calm_since_step = step;
      object.resting = false;
    }
    // Somebody beside it wakes it, again and again. Laid to sleep again at once it would fall a step each
    // time: Bullet finds who is awake after it has left out the contacts of those who slept.
    if (object.asleep && body.getActivationState() == ACTIVE_TAG) {
      object.asleep = false;
      object.calm_since_step = step;
    }
    if (step - object.calm_since_step < kRestSteps) return;
    if (body.isActive()) {
      body.setLinearVelocity({0, 0, 0});
      body.setAngularVelocity({0, 0, 0});
      body.forceActivationState(ISLAND_SLEEPING);
    }
    object.asleep = true;
    if (!object.resting) {
      PhysicsEvent event{.kind = PhysicsEventKind::kRest,
                         .t_us = now_us,
                         .object = id,
                         .name = object.name,
                         .point = center};
      Say(std::move(event));
    }
    object.resting = true;
  }

  void FindContacts() {
    for (int i = 0; i < dispatcher.getNumManifolds(); ++i) {
      const btPersistentManifold& manifold = *dispatcher.getManifoldByIndexInternal(i);
      const btCollisionObject* a = manifold.getBody0();
      const btCollisionObject* b = manifold.getBody1();
      if (!a->hasContactResponse() || !b->hasContactResponse()) continue;
      // The free object with the smaller id speaks.
      bool swapped = false;
      if (a->isStaticOrKinematicObject() ||
          (!b->isStaticOrKinematicObject() && b->getUserIndex() < a->getUserIndex())) {
        std::swap(a, b);
        swapped = true;
      }
      if (a->isStaticOrKinematicObject() || a->getUserIndex() <= 0) continue;
      const btManifoldPoint* deepest = nullptr;
      double impulse_ns = 0;
      for (int k = 0; k < manifold.getNumContacts(); ++k) {
        const btManifoldPoint& point = manifold.getContactPoint(k);
        impulse_ns += static_cast<double>(point.getAppliedImpulse());
        if (deepest == nullptr || point.getDistance() < deepest->getDistance()) deepest = &point;
      }
      if (!(impulse_ns > 0)) continue;
      const std::pair pair(a->getUserIndex(), b->getUserIndex());
      const auto known = touching.find(pair);
      const bool is_new = known == touching.end() || step - known->second > kApartSteps;
      touching[pair] = step;
      if (!is_new) continue;
      const auto object = objects.find(static_cast<std::uint32_t>(a->getUserIndex()));
      if (object == objects.end()) continue;
      PhysicsEvent event{.kind = PhysicsEventKind::kTouch,
                         .t_us = now_us,
                         .object = object->first,
                         .name = object->second.name,
                         .point = FromBullet(deepest->getPositionWorldOnB()),
                         .normal = (swapped ? -1.0 : 1.0) * FromBullet(deepest->m_normalWorldOnB),
                         .impulse_ns = impulse_ns};
      NameOther(b->getUserIndex(), event);
      Say(std::move(event));
    }
    if (step % kPhysicsStepsPerSecond == 0)
      std::erase_if(touching, [&](const auto& entry) { return step - entry.second > kApartSteps; });
  }

  void NameOther(int index, PhysicsEvent& event) const {
    if (index == kActorIndex) event.with = "actor";
    if (index == kFloorIndex) event.with = "floor";
    if (index == kRoomIndex) {
      event.with = "room";
      for (const NamedPlane& plane : planes) {
        if (std::abs(plane.normal.dot(event.point) + plane.d) < 0.03 &&
            plane.normal.dot(event.normal) > 0.8 && plane.extent.exteriorDistance(event.point) < 0.1) {
          event.with = plane.name;
          break;
        }
      }
    }
    if (index <= 0) return;
    event.with_object = static_cast<std::uint32_t>(index);
    const auto other = objects.find(event.with_object);
    if (other != objects.end()) event.with = other->second.name;
  }

  const SceneFrame frame;
  const Eigen::Vector3d up;
  btDefaultCollisionConfiguration configuration;
  btGjkEpaPenetrationDepthSolver penetration;
  btConvexConvexAlgorithm::CreateFunc on_triangles{&penetration};
  btCollisionDispatcher dispatcher;
  btDbvtBroadphase broadphase;
  btSequentialImpulseConstraintSolver solver;
  btDiscreteDynamicsWorld world;
  std::unique_ptr<btStaticPlaneShape> floor_shape;
  std::unique_ptr<btRigidBody> floor, room;
  // The room's triangles, as Bullet reads them in place.
  std::vector<Eigen::Vector3f> positions;
  std::vector<int> indices;
  std::unique_ptr<btTriangleIndexVertexArray> triangles;
  std::unique_ptr<btBvhTriangleMeshShape> room_shape;
  std::unique_ptr<btTriangleInfoMap> edges;
  std::vector<NamedPlane> planes;

  std::map<std::uint32_t, Object> objects;
  std::map<std::uint32_t, Ball> balls;
  std::map<std::pair<int, int>, std::int64_t> touching;  // the step in which they did so last
  std::vector<PhysicsEvent> events;
  bool active = false;
  std::int64_t step = 0;
  std::int64_t now_us = 0;
  std::optional<std::int64_t> start_us;  // of step 0
};

Physics::Physics(SceneFrame frame) : state_(std::make_unique<State>(frame)) {}
Physics::~Physics() = default;

void Physics::SetRoom(std::span<const Eigen::Vector3f> positions, std::span<const std::uint32_t> indices,
                      std::vector<NamedPlane> planes, double floor_m) {
  State& s = *state_;
  if (s.room) s.world.removeRigidBody(s.room.get());
  s.room.reset();
  s.room_shape.reset();
  s.triangles.reset();
  s.planes = std::move(planes);
  s.positions.assign(positions.begin(), positions.end());
  s.indices.clear();
  for (std::size_t t = 0; t + 2 < indices.size(); t += 3) {
    bool on_floor = s.frame == SceneFrame::kWorld;
    for (std::size_t k = 0; k < 3; ++k) {
      MIX_CHECK(indices[t + k] < positions.size());
      const Eigen::Vector3f& p = positions[indices[t + k]];
      MIX_CHECK(p.allFinite());
      on_floor = on_floor && std::abs(static_cast<double>(p.z())) < floor_m;
    }
    if (on_floor) continue;
    for (std::size_t k = 0; k < 3; ++k) s.indices.push_back(static_cast<int>(indices[t + k]));
  }
  if (s.indices.empty()) return;
  s.triangles = std::make_unique<btTriangleIndexVertexArray>(
      static_cast<int>(s.indices.size() / 3), s.indices.data(), static_cast<int>(3 * sizeof(int)),
      static_cast<int>(s.positions.size()), s.positions.front().data(),
      static_cast<int>(sizeof(Eigen::Vector3f)));
  s.room_shape = std::make_unique<btBvhTriangleMeshShape>(s.triangles.get(), true);
  s.room_shape->setMargin(0);
  s.edges = std::make_unique<btTriangleInfoMap>();
  btGenerateInternalEdgeInfo(s.room_shape.get(), s.edges.get());
  s.room = s.AddStanding(*s.room_shape, kRoomIndex);
  for (auto& [id, object] : s.objects) {
    if (object.free) object.body->activate(true);
  }
}

void Physics::SetScene(const Scene& scene) {
  State& s = *state_;
  MIX_CHECK(scene.frame == s.frame);
  for (auto object = s.objects.begin(); object != s.objects.end();) {
    const auto found = std::ranges::find(scene.objects, object->first, &SceneObject::id);
    if (found != scene.objects.end() && found->mesh == object->second.mesh) {
      ++object;
      continue;
    }
    if (object->second.body) s.Wake(*object->second.body);
    s.Take(object->second);
    object = s.objects.erase(object);
  }
  s.active = std::ranges::any_of(scene.objects, [](const SceneObject& o) { return o.drop && !o.hidden; });
  for (const SceneObject& source : scene.objects) {
    State::Object& object = s.objects[source.id];
    const bool is_new = object.mesh == nullptr;
    const bool put = is_new || object.put != source.put;
    const bool was_free = object.free || object.free_at.has_value();
    const bool other = object.drop != source.drop || object.hidden != source.hidden ||
                       object.kind != source.body || object.mass_kg != source.mass_kg ||
                       object.friction != source.friction || object.restitution != source.restitution;
    object.name = source.name;
    object.put = source.put;
    object.mesh = source.mesh;
    object.kind = source.body;
    object.drop = source.drop;
    object.hidden = source.hidden;
    object.mass_kg = source.mass_kg;
    object.friction = source.friction;
    object.restitution = source.restitution;
    if (put) {
      object.T_put = object.T_now = source.T_scene_object;
      object.unable = false;
      object.free_at.reset();
    } else if (other) {
      object.T_put = object.T_now;  // it goes on from where it is
    }
    if (!s.active || source.hidden) {
      if (object.body) s.Wake(*object.body);
      object.T_put = object.T_now;
      s.Take(object);
      continue;
    }
    if (!put && !other && object.body) continue;
    const bool free = source.drop && !object.unable;
    if (free && put && was_free) {
      object.free_at = s.step + kDragSteps;
      s.Enter(source.id, object, false);
    } else {
      s.Enter(source.id, object, free && !object.free_at);
    }
  }
}

void Physics::PutBack(const SceneObject& source) {
  State& s = *state_;
  const auto found = s.objects.find(source.id);
  if (found == s.objects.end() || !found->second.body) return;
  State::Object& object = found->second;
  s.Wake(*object.body);
  object.T_put = object.T_now = source.T_scene_object;
  object.unable = false;
  object.free_at.reset();
  s.Enter(source.id, object, object.drop);
}

bool Physics::active() const { return state_->active; }

std::vector<Eigen::AlignedBox3d> Physics::ActorReach() const {
  std::vector<Eigen::AlignedBox3d> boxes;
  for (const auto& [id, object] : state_->objects) {
    if (!object.free || object.kind != Body::kActor) continue;
    btVector3 low;
    btVector3 high;
    object.body->getAabb(low, high);
    const Eigen::Vector3d reach = Eigen::Vector3d::Constant(kReachM);
    boxes.emplace_back(FromBullet(low) - reach, FromBullet(high) + reach);
  }
  return boxes;
}

void Physics::StepTo(std::int64_t t_us, std::span<const ActorBall> actor) {
  State& s = *state_;
  const auto steps_at = [&](std::int64_t t) {
    return (t - *s.start_us) * kPhysicsStepsPerSecond / 1'000'000;
  };
  if (!s.start_us) s.start_us = t_us - s.step * 1'000'000 / kPhysicsStepsPerSecond;
  std::int64_t steps = steps_at(t_us) - s.step;
  if (steps < 0 || steps > kMostSteps) {
    steps = std::clamp<std::int64_t>(steps, 0, kMostSteps);
    s.start_us = t_us - (s.step + steps) * 1'000'000 / kPhysicsStepsPerSecond;
  }
  s.now_us = t_us;
  if (!s.active) {
    s.step += steps;
    if (!s.balls.empty()) s.SetBalls({});
    return;
  }
  s.SetBalls(actor);
  for (std::int64_t i = 1; i <= steps; ++i) s.Step(static_cast<double>(i) / static_cast<double>(steps));
}

bool Physics::WritePoses(Scene& posed) {
  State& s = *state_;
  bool moved = false;
  for (SceneObject& object : posed.objects) {
    const auto found = s.objects.find(object.id);
    if (found == s.objects.end()) continue;
    State::Object& known = found->second;
    if (known.free) {
      const Eigen::Affine3d T = FromBullet(known.body->getWorldTransform()) * known.shape->T_body_object;
      if (IsSeenToMove(known.T_now, T)) known.T_now = T;
    } else if (known.body) {
      known.T_now = known.T_put;
    }
    moved = moved || object.T_scene_object.matrix() != known.T_now.matrix();
    object.T_scene_object = known.T_now;
  }
  return moved;
}

std::vector<PhysicsEvent> Physics::TakeEvents() { return std::exchange(state_->events, {}); }

}  // namespace mixstage
