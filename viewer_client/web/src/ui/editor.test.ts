// SPDX-License-Identifier: Apache-2.0
import { beforeEach, describe, expect, it, vi } from 'vitest';
import type { Edit } from '../transport/edit';
import type { SceneLight } from '../transport/scene';
import { project } from '../view/geometry';
import { EditSender } from './edit_sender';
import { Editor } from './editor';
import { kLamp, kScene, kStatue } from './scene_fixture';

const kPinhole = { width: 640, height: 480, fx: 500, fy: 500, cx: 320, cy: 240 };
const kPose = [0, 0, 1, 0, -1, 0, 0, 0, 0, -1, 0, 1.5];

let sent: Edit[];
let told: string[];
let now_ms: number;
let editor: Editor;

beforeEach(() => {
  sent = [];
  told = [];
  now_ms = 10_000;
  const clock = (): number => now_ms;
  editor = new Editor(
    new EditSender((edit) => sent.push(edit), clock),
    { onChange: vi.fn(), onNotice: (sentence) => told.push(sentence) },
    clock,
  );
  editor.setHello('director', kPinhole);
  editor.setScene(kScene);
  editor.setPose(kPose);
});

/** A pixel on the box, a little above its foot. */
function onBox(): [number, number] {
  const view = editor.program_view;
  const pixel = view === null ? null : project(view, [4, 0, 0.3]);
  if (pixel === null) throw new Error('not in sight');
  return [pixel.u, pixel.v];
}

describe('the editor', () => {
  it('drags what was taken so that its base moves as the pointer does', () => {
    const [u, v] = onBox();
    expect(editor.pressProgram(u, v)).toBe(true);
    expect(editor.selected?.id).toBe(7);
    editor.dragProgram(u + 30, v + 10);
    editor.release();
    const base = project(editor.program_view ?? { T_scene_camera: kPose, pinhole: kPinhole }, kStatue.base);
    const move = { op: 'move', object: 7, on: 'floor', u: (base?.u ?? 0) + 30, v: (base?.v ?? 0) + 10 };
    expect(sent).toEqual([
      { type: 'edit', id: 1, ...move, live: true },
      { type: 'edit', id: 2, ...move, live: false },
    ]);
  });

  it('adopts what is clicked, once, and only for a director', () => {
    editor.place({ what: 'adopt' });
    expect(editor.pressProgram(100, 200)).toBe(false);
    expect(sent).toEqual([{ type: 'edit', id: 1, op: 'adopt', u: 100, v: 200 }]);
    expect(editor.placing).toBeNull();
    editor.setHello('viewer', kPinhole);
    editor.place({ what: 'adopt' });
    expect(editor.placing).toBeNull();
  });

  it('sends nothing for a click, even one that shakes a little', () => {
    const [u, v] = onBox();
    editor.pressProgram(u, v);
    editor.dragProgram(u + 2, v - 2);
    editor.release();
    expect(sent).toEqual([]);
    expect(editor.selected?.id).toBe(7);
    editor.pressProgram(5, 5);
    expect(editor.selected).toBeNull();
  });

  it('drags in the 3D view to where the pointer meets the plane of its base', () => {
    const view = { T_scene_camera: kPose, pinhole: kPinhole };
    const [u, v] = onBox();
    expect(editor.pressRoom(view, u, v)).toBe(true);
    editor.dragRoom(view, u - 100, v);
    editor.release();
    const last = sent.at(-1);
    if (last?.op !== 'move' || !('position' in last)) throw new Error('no position');
    expect(last.live).toBe(false);
    expect(last.position[2]).toBeCloseTo(0, 9);
    expect(last.position[1]).toBeCloseTo(0.8, 6);
  });

  it('places by one click, and only one', () => {
    editor.place({ what: 'add', file: 'vase.glb' });
    editor.pressProgram(100, 400);
    editor.pressProgram(100, 400);
    expect(sent).toEqual([{ type: 'edit', id: 1, op: 'add', file: 'vase.glb', u: 100, v: 400 }]);
  });

  it('lets a viewer select, and nothing else', () => {
    editor.setHello('viewer', kPinhole);
    const [u, v] = onBox();
    expect(editor.pressProgram(u, v)).toBe(false);
    expect(editor.selected?.id).toBe(7);
    editor.place({ what: 'add', file: 'vase.glb' });
    editor.doSelected(({ id }) => ({ op: 'delete', object: id }));
    editor.do({ op: 'undo' });
    editor.turn(15);
    editor.nudge(1, 0);
    expect(sent).toEqual([]);
    expect(editor.placing).toBeNull();
  });

  it('nudges away from the camera and right of it', () => {
    editor.select(7);
    editor.nudge(0, 0.05);
    now_ms += 2000;
    editor.nudge(0.05, 0);
    const [away, right] = sent;
    expect(away).toMatchObject({ op: 'move', position: [4.05, 0, 0] });
    expect(right).toMatchObject({ op: 'move', position: [4, -0.05, 0] });
  });

  it('loses no step of a key that is held, however late the server answers', () => {
    editor.select(7);
    for (let press = 0; press < 4; ++press) {
      editor.nudge(0, 0.25);
      now_ms += 100;
    }
    expect(sent).toHaveLength(4);
    expect(sent[3]).toMatchObject({ op: 'move', object: 7, position: [5, 0, 0] });
    editor.do({ op: 'undo' });
    editor.nudge(0, 0.25);
    expect(sent.at(-1)).toMatchObject({ op: 'undo' });
    now_ms += 100;
    editor.nudge(0, 0.25);
    expect(sent.at(-1)).toMatchObject({ position: [4.5, 0, 0] });
  });

  it('drags a light in the 3D view at its distance from the eye, before what lies behind it', () => {
    const lamp: SceneLight = { ...kLamp, position: [3, 0, 0.5] };
    editor.setScene({ ...kScene, lights: [lamp] });
    const view = { T_scene_camera: kPose, pinhole: kPinhole };
    const at = project(view, lamp.position);
    if (at === null) throw new Error('not in sight');
    expect(editor.pressRoom(view, at.u + 5, at.v)).toBe(true);
    editor.dragRoom(view, at.u + 5 - 50, at.v - 100);
    editor.release();
    const last = sent.at(-1);
    if (last?.op !== 'light' || last.position === undefined) throw new Error('no position');
    expect(last.live).toBe(false);
    [3, 0.3, 1.1].forEach((value, axis) => expect(last.position?.[axis]).toBeCloseTo(value, 9));
    editor.setHello('viewer', kPinhole);
    expect(editor.pressRoom(view, at.u, at.v)).toBe(false);
  });

  it('moves a light by keys, and turns one that shines from far away', () => {
    const sun: SceneLight = { ...kLamp, id: 4, name: 'sun', kind: 'directional', position: [1, 0, 0] };
    editor.setScene({ ...kScene, lights: [kLamp, sun] });
    const steps = [
      [3, { right: 0.05, away: 0, up: 0 }],
      [3, { right: 0, away: 0.05, up: 0.01 }],
      [4, { right: 0, away: Math.PI / 6, up: 0 }],
      [4, { right: Math.PI / 2, away: 0, up: 0 }],
    ] as const;
    for (const [id, step] of steps) {
      editor.nudgeLight(id, step);
      now_ms += 100;
    }
    const to = sent.map((edit) => (edit.op === 'light' ? edit.position : undefined));
    const wanted = [
      [3, -0.05, 2],
      [3.05, -0.05, 2.01],
      [Math.cos(Math.PI / 6), 0, 0.5],
      [0, -Math.cos(Math.PI / 6), 0.5],
    ];
    wanted.forEach((position, index) =>
      position.forEach((value, axis) => expect(to[index]?.[axis]).toBeCloseTo(value, 9)),
    );
  });

  it('moves the actor who stands elsewhere by keys', () => {
    editor.nudgeAvatar({ right: 0.25, away: 0, up: 0 });
    expect(sent).toEqual([]);
    editor.setScene({ ...kScene, avatar: { position: [1, 2, 0], turn_deg: 0 } });
    editor.nudgeAvatar({ right: 0.25, away: 0, up: 0 });
    now_ms += 100;
    editor.nudgeAvatar({ right: 0, away: 0.25, up: 0 });
    expect(sent.at(-1)).toMatchObject({ op: 'avatar', position: [1.25, 1.75, 0] });
  });

  it('leads what is selected by the hand while the pose is not known', () => {
    editor.forget();
    editor.setScene(kScene);
    expect(editor.program_view).toBeNull();
    expect(editor.pressProgram(10, 300)).toBe(false);
    editor.select(7);
    expect(editor.pressProgram(10, 300)).toBe(true);
    editor.dragProgram(20, 310);
    expect(sent[0]).toMatchObject({ op: 'move', object: 7, u: 20, v: 310, on: 'floor' });
  });

  it('tells what another did with his name, and says nothing of its own echo', () => {
    const moved = {
      ...kScene,
      by: 'anna',
      edits: 1,
      objects: [{ ...kStatue, base: [4, 1, 0] as [number, number, number] }],
    };
    editor.setUser('ben');
    editor.setScene(moved);
    expect(told).toEqual(['anna moved statue']);
    editor.do({ op: 'undo' });
    editor.setScene({ ...kScene, by: 'ben', edits: 2 });
    expect(told.length).toBe(1);
    editor.do({ op: 'redo' });
    editor.setScene({ ...moved, by: 'anna', edits: 3 });
    expect(told.length).toBe(2);
  });

  it('lets go of what is no longer there', () => {
    const [u, v] = onBox();
    editor.pressProgram(u, v);
    editor.dragProgram(u + 30, v);
    editor.setScene({ ...kScene, objects: [] });
    editor.dragProgram(u + 60, v);
    editor.release();
    expect(editor.selected).toBeNull();
    expect(sent.length).toBe(1);
  });
});
