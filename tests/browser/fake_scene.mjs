// SPDX-License-Identifier: Apache-2.0
// The scene of the fake show and what edits do to it (SPEC 4.5), in memory.
import { kRoom } from './fake_picture.mjs';

const kModels = {
  'statue.glb': { half: 0.22, height: 1.1, color: [196, 178, 150] },
  'vase.glb': { half: 0.16, height: 0.55, color: [64, 120, 170] },
  'crate.glb': { half: 0.3, height: 0.5, color: [150, 104, 60] },
};

/** Metres from the colour picture's pixel to a horizontal plane; null above its horizon. */
function under({ T, fx, fy, cx, cy }, u, v, height) {
  const d = [(u - cx) / fx, (v - cy) / fy, 1];
  const along = [0, 1, 2].map((row) => T[4 * row] * d[0] + T[4 * row + 1] * d[1] + T[4 * row + 2] * d[2]);
  const t = (height - T[11]) / along[2];
  if (!(t > 0)) return null;
  const [x, y] = [T[3] + t * along[0], T[7] + t * along[1]];
  return x < kRoom.x[1] && Math.abs(y) < kRoom.y[1] ? [x, y, height] : null;
}

export class FakeScene {
  #camera;
  #revision = 1;
  #next_id = 3;
  #undone = [];
  #done = [];
  #before_drag = null;
  #saved = '';
  by = '';
  state = {
    objects: [
      { id: 1, file: 'statue.glb', base: [3.7, 0.75, 0], turn_deg: 25, hidden: false },
      { id: 2, file: 'vase.glb', base: [4.3, -0.9, 0], turn_deg: 0, hidden: false },
    ],
    lights: [
      {
        id: 1,
        name: 'ceiling',
        kind: 'area',
        position: [3.4, 0.3, 2.6],
        color: [1, 0.89, 0.71],
        intensity: 6,
      },
      {
        id: 2,
        name: 'window',
        kind: 'directional',
        position: [0, 0.71, 0.71],
        color: [0.69, 0.85, 1],
        intensity: 0.25,
      },
    ],
  };

  constructor(camera) {
    this.#camera = camera;
    this.#saved = JSON.stringify(this.state);
  }

  model(file) {
    return kModels[file];
  }

  /** What the ray caster draws. */
  get boxes() {
    return this.state.objects
      .filter(({ hidden }) => !hidden)
      .map(({ base, turn_deg, file }) => ({
        ...kModels[file],
        base,
        turn_rad: (turn_deg * Math.PI) / 180,
        actor: false,
      }));
  }

  message() {
    const objects = this.state.objects.map(({ id, file, base, turn_deg, hidden }) => {
      const { half, height } = kModels[file];
      const [c, s] = [Math.cos((turn_deg * Math.PI) / 180), Math.sin((turn_deg * Math.PI) / 180)];
      return {
        id,
        name: file.replace('.glb', ''),
        file,
        pose: [c, -s, 0, base[0], s, c, 0, base[1], 0, 0, 1, base[2], 0, 0, 0, 1],
        body: 'mutual',
        triangles: 10,
        bounds: [-half, -half, 0, half, half, height],
        base,
        radius_m: half * Math.SQRT2,
        hidden,
      };
    });
    return {
      type: 'scene',
      revision: this.#revision,
      frame: 'world',
      up: [0, 0, 1],
      can_undo: this.#done.length > 0,
      can_redo: this.#undone.length > 0,
      unsaved: JSON.stringify(this.state) !== this.#saved,
      by: this.by,
      objects,
      lights: this.state.lights,
      models: Object.keys(kModels),
    };
  }

  /** Null when it was done, else the sentence that refuses it. */
  edit(edit, by) {
    const before = JSON.stringify(this.state);
    const reason = this.#apply(edit);
    if (reason !== null) return reason;
    this.by = by;
    this.#revision += 1;
    if (['undo', 'redo', 'save'].includes(edit.op)) return null;
    this.#before_drag ??= before;
    if (edit.live === true) return null;
    this.#done.push(this.#before_drag);
    this.#before_drag = null;
    this.#undone = [];
    return null;
  }

  #apply(edit) {
    const object = this.state.objects.find(({ id }) => id === edit.object);
    if (edit.object !== undefined && object === undefined) return `There is no object ${edit.object}.`;
    switch (edit.op) {
      case 'add': {
        if (kModels[edit.file] === undefined) return `There is no model ${edit.file} beside scene.yaml.`;
        const base = under(this.#camera, edit.u, edit.v, 0);
        if (base === null) return 'Nothing can stand there: the room has no floor under this pixel.';
        this.state.objects.push({ id: this.#next_id++, file: edit.file, base, turn_deg: 0, hidden: false });
        return null;
      }
      case 'move': {
        const height = edit.on === 'floor' ? object.base[2] : 0;
        const base = edit.position ?? under(this.#camera, edit.u, edit.v, height);
        if (base === null) return 'Nothing can stand there: the room has no floor under this pixel.';
        object.base = base;
        return null;
      }
      case 'turn':
        object.turn_deg += edit.angle_deg;
        return null;
      case 'drop':
        object.base = [object.base[0], object.base[1], 0];
        return null;
      case 'hide':
        object.hidden = edit.hidden;
        return null;
      case 'delete':
        this.state.objects = this.state.objects.filter((one) => one !== object);
        return null;
      case 'light': {
        const light = this.state.lights.find(({ id }) => id === edit.light);
        if (light === undefined) return `There is no light ${edit.light}.`;
        for (const key of ['position', 'color', 'intensity'])
          if (edit[key] !== undefined) light[key] = edit[key];
        return null;
      }
      case 'undo':
        return this.#step(this.#done, this.#undone, 'Nothing is left to undo.');
      case 'redo':
        return this.#step(this.#undone, this.#done, 'Nothing is left to redo.');
      case 'save':
        this.#saved = JSON.stringify(this.state);
        return null;
      default:
        return `An edit ${edit.op} is not known.`;
    }
  }

  #step(from, to, none) {
    if (from.length === 0) return none;
    to.push(JSON.stringify(this.state));
    this.state = JSON.parse(from.pop());
    return null;
  }
}
