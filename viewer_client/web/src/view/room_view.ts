// SPDX-License-Identifier: Apache-2.0
import { PerspectiveCamera, WebGLRenderer } from 'three';
import type { DracoReader } from '../decode/draco_mesh';
import type { Vector3 } from '../transport/scene';
import { rotate, type Pose } from './geometry';
import { MeshInbox } from './mesh_inbox';
import type { FromRoom, Look, MeshParcel, RoomCounts } from './room_messages';
import { RoomScene } from './room_scene';
import { matrixOf } from './room_shapes';

const kGround = 0x0a0b0d;
const kNear_m = 0.05;
const kFar_m = 200;
const kMostTexture_px = 8192;

/** What the browser gives, so that a picture is drawn with the next one of the screen. */
type Schedule = (draw: () => void) => void;

/** The 3D pane in its worker: decodes what comes, draws when something changed and not otherwise. */
export class RoomView {
  readonly scene = new RoomScene();
  readonly #renderer: WebGLRenderer;
  readonly #camera = new PerspectiveCamera();
  readonly #inbox = new MeshInbox();
  readonly #draco: DracoReader;
  readonly #post: (message: FromRoom) => void;
  readonly #schedule: Schedule;
  readonly #counts: Omit<RoomCounts, 'superseded'> = {
    drawn: 0,
    meshes: 0,
    refused: 0,
    last_trouble: '',
    triangles: 0,
    draw_ms: 0,
  };
  #look: Look;
  #decoding = false;
  #asked = false;
  #lost = false;
  /** Counts connections: a mesh that was decoded for an earlier one is not shown. */
  #generation = 0;

  /** Throws where the browser has no WebGL2. */
  constructor(
    canvas: OffscreenCanvas,
    look: Look,
    draco: DracoReader,
    post: (message: FromRoom) => void,
    schedule: Schedule,
  ) {
    this.#renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: 'low-power' });
    this.#renderer.setClearColor(kGround);
    this.#camera.matrixAutoUpdate = false;
    this.#look = look;
    this.#draco = draco;
    this.#post = post;
    this.#schedule = schedule;
    canvas.addEventListener('webglcontextlost', () => this.#setLost(true));
    canvas.addEventListener('webglcontextrestored', () => this.#setLost(false));
    this.look(look);
  }

  get counts(): RoomCounts {
    return { ...this.#counts, superseded: this.#inbox.superseded };
  }

  look(look: Look): void {
    this.#look = look;
    if (look.width === 0) return;
    const { width, height } = this.#renderer.domElement;
    if (width !== look.width || height !== look.height)
      this.#renderer.setSize(look.width, look.height, false);
    this.#camera.fov = (look.vertical_field_rad * 180) / Math.PI;
    this.#camera.aspect = look.width / look.height;
    this.#camera.near = kNear_m;
    this.#camera.far = kFar_m;
    this.#camera.updateProjectionMatrix();
    this.#camera.matrix.copy(matrixOf(asOpenGl(look.T_scene_eye)));
    this.#camera.matrixWorldNeedsUpdate = true;
    this.redraw();
  }

  /** With the next picture of the screen, once, however often it is asked. */
  redraw(): void {
    if (this.#asked || this.#look.width === 0 || this.#lost) return;
    this.#asked = true;
    this.#schedule(() => this.#draw());
  }

  push(parcel: MeshParcel): void {
    // Where the camera stood is known without decoding anything.
    if (parcel.stream === 'actor') {
      this.scene.setPose(parcel.T_scene_color);
      this.#post({ type: 'pose', T_scene_color: parcel.T_scene_color });
      this.redraw();
    }
    this.#inbox.push(parcel);
    if (!this.#decoding) void this.#decodeAll();
  }

  /** Another connection: what was shown is of the last one. */
  forget(): void {
    this.#generation += 1;
    this.#inbox.clear();
    this.scene.clear();
    this.redraw();
  }

  /** The nearest surface under a place of the pane, 0..1 from its left and upper edge. */
  touch(u: number, v: number): Vector3 | null {
    this.#camera.updateMatrixWorld();
    return this.scene.touch(this.#camera, 2 * u - 1, 1 - 2 * v);
  }

  async #decodeAll(): Promise<void> {
    this.#decoding = true;
    for (let parcel = this.#inbox.take(); parcel !== null; parcel = this.#inbox.take())
      await this.#decode(parcel);
    this.#decoding = false;
  }

  async #decode(parcel: MeshParcel): Promise<void> {
    const generation = this.#generation;
    if (parcel.mesh.byteLength === 0) {
      this.scene.put(parcel, null, null);
      return this.redraw();
    }
    const texture = parcel.texture.byteLength > 0 ? this.#textureOf(parcel.texture) : null;
    const mesh = await this.#draco.decode(parcel.mesh);
    const picture = await texture;
    if (!mesh.ok || generation !== this.#generation) {
      picture?.close();
      return mesh.ok ? undefined : this.#refuse(`${parcel.stream}: ${mesh.reason}`);
    }
    this.scene.put(parcel, mesh.value, picture);
    this.#counts.meshes += 1;
    this.redraw();
  }

  /** Null when it is no JPEG, or too large: the mesh is shown grey. */
  async #textureOf(bytes: Uint8Array): Promise<ImageBitmap | null> {
    try {
      const blob = new Blob([bytes as Uint8Array<ArrayBuffer>], { type: 'image/jpeg' });
      const picture = await createImageBitmap(blob, {
        premultiplyAlpha: 'none',
        colorSpaceConversion: 'none',
      });
      if (Math.max(picture.width, picture.height) <= kMostTexture_px) return picture;
      picture.close();
      this.#refuse(`texture of ${picture.width} x ${picture.height}`);
    } catch {
      this.#refuse('texture is no picture');
    }
    return null;
  }

  #refuse(reason: string): void {
    this.#counts.refused += 1;
    this.#counts.last_trouble = reason;
  }

  #draw(): void {
    this.#asked = false;
    if (this.#look.width === 0 || this.#lost) return;
    const begun_ms = performance.now();
    this.#renderer.render(this.scene.graph, this.#camera);
    this.#counts.drawn += 1;
    this.#counts.triangles = this.#renderer.info.render.triangles;
    this.#counts.draw_ms = performance.now() - begun_ms;
  }

  #setLost(lost: boolean): void {
    this.#lost = lost;
    this.#post({
      type: 'trouble',
      sentence: lost ? 'The graphics driver was reset; the 3D view comes back by itself.' : '',
    });
    this.redraw();
  }
}

/** The same camera with OpenGL's axes: y up, z back. */
function asOpenGl(T: Pose): Pose {
  const [y, z] = [rotate(T, [0, -1, 0]), rotate(T, [0, 0, -1])];
  const at = (index: number): number => T[index] ?? 0;
  return [at(0), y[0], z[0], at(3), at(4), y[1], z[1], at(7), at(8), y[2], z[2], at(11)];
}
