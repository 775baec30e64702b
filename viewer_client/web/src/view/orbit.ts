// SPDX-License-Identifier: Apache-2.0
import type { Pinhole } from '../transport/control_message';
import type { Vector3 } from '../transport/scene';
import {
  add,
  cross,
  dot,
  horizontal,
  normalize,
  origin,
  rotate,
  scale,
  type Pose,
  type Viewpoint,
} from './geometry';

// Across the pane's shorter side: a high and narrow pane sees as much as a wide one.
const kField_rad = (50 * Math.PI) / 180;
const kLeastDistance_m = 0.3;
const kMostDistance_m = 30;
// Straight down or up there would be no sideways.
const kSteepest_rad = (88 * Math.PI) / 180;
// Following looks over the camera's shoulder: this far ahead of it, from this far away.
const kAhead_m = 1.2;
const kBehind_m = 3.2;

/** Where the 3D pane is looked at from: a point, and how the eye stands from it. */
export class Orbit {
  #up: Vector3 = [0, 0, 1];
  #target: Vector3 = [2.5, 0, 0.8];
  #yaw_rad = Math.PI + 0.6;
  #pitch_rad = 0.45;
  #distance_m = 5.5;
  #follows = false;
  #camera: Pose | null = null;

  get follows(): boolean {
    return this.#follows;
  }

  /** Another up makes what was looked at meaningless. */
  setUp(up: Vector3): void {
    if (up.every((value, axis) => value === this.#up[axis])) return;
    this.#up = up;
    if (this.#camera !== null) this.lookOver(this.#camera);
  }

  /** The rig's camera has moved. */
  setCamera(T_scene_camera: Pose): void {
    const first = this.#camera === null;
    const before = this.#camera;
    this.#camera = T_scene_camera;
    if (first) this.lookOver(T_scene_camera);
    else if (this.#follows && before !== null) {
      // The eye keeps its place beside the camera: it goes and turns along.
      this.#yaw_rad += this.#yawOf(T_scene_camera) - this.#yawOf(before);
      this.#target = this.#aheadOf(T_scene_camera);
    }
  }

  /** Stands behind and above a camera and sees what it sees. */
  lookOver(T_scene_camera: Pose): void {
    this.#target = this.#aheadOf(T_scene_camera);
    this.#yaw_rad = this.#yawOf(T_scene_camera) + Math.PI - 0.5;
    this.#pitch_rad = 0.5;
    this.#distance_m = kBehind_m + 1.5;
  }

  toggleFollow(): void {
    this.#follows = !this.#follows && this.#camera !== null;
    if (!this.#follows || this.#camera === null) return;
    this.#target = this.#aheadOf(this.#camera);
    this.#yaw_rad = this.#yawOf(this.#camera) + Math.PI;
    this.#pitch_rad = 0.35;
    this.#distance_m = kBehind_m;
  }

  turn(yaw_rad: number, pitch_rad: number): void {
    this.#yaw_rad += yaw_rad;
    this.#pitch_rad = Math.min(kSteepest_rad, Math.max(-kSteepest_rad, this.#pitch_rad + pitch_rad));
  }

  /** Above 1 goes away. */
  zoom(factor: number): void {
    this.#distance_m = Math.min(kMostDistance_m, Math.max(kLeastDistance_m, this.#distance_m * factor));
  }

  /** Moves what is looked at, in parts of the pane's shorter side. Following ends: the hand wins. */
  pan(right: number, down: number): void {
    this.#follows = false;
    const side_m = 2 * this.#distance_m * Math.tan(kField_rad / 2);
    const T = this.#T_scene_eye;
    const move = add(rotate(T, [-right * side_m, 0, 0]), rotate(T, [0, -down * side_m, 0]));
    this.#target = add(this.#target, move);
  }

  centre(point: Vector3): void {
    this.#follows = false;
    this.#target = point;
  }

  /** The eye as a camera of a width x height pane. */
  viewpoint(width: number, height: number): Viewpoint {
    const focal = Math.min(width, height) / 2 / Math.tan(kField_rad / 2);
    const pinhole: Pinhole = {
      width,
      height,
      fx: focal,
      fy: focal,
      cx: width / 2 - 0.5,
      cy: height / 2 - 0.5,
    };
    return { T_scene_camera: this.#T_scene_eye, pinhole };
  }

  get #T_scene_eye(): Pose {
    const [e0, e1] = horizontal(this.#up);
    const around = add(scale(e0, Math.cos(this.#yaw_rad)), scale(e1, Math.sin(this.#yaw_rad)));
    const out = add(scale(around, Math.cos(this.#pitch_rad)), scale(this.#up, Math.sin(this.#pitch_rad)));
    const eye = add(this.#target, scale(out, this.#distance_m));
    const z = scale(out, -1);
    const x = normalize(cross(z, this.#up));
    const y = cross(z, x);
    return [x[0], y[0], z[0], eye[0], x[1], y[1], z[1], eye[1], x[2], y[2], z[2], eye[2]];
  }

  /** The direction that a camera looks in, about up. */
  #yawOf(T_scene_camera: Pose): number {
    const [e0, e1] = horizontal(this.#up);
    const z = rotate(T_scene_camera, [0, 0, 1]);
    return Math.atan2(dot(z, e1), dot(z, e0));
  }

  #aheadOf(T_scene_camera: Pose): Vector3 {
    return add(origin(T_scene_camera), scale(rotate(T_scene_camera, [0, 0, 1]), kAhead_m));
  }
}
