// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { MeshInbox } from './mesh_inbox';
import type { MeshParcel } from './room_messages';

function parcel(stream: MeshParcel['stream'], id = 0, mark = 0): MeshParcel {
  return { stream, id, T_scene_color: [], mesh: new Uint8Array([mark]), texture: new Uint8Array(0) };
}

describe('the mesh inbox', () => {
  it('keeps of each thing the newest, in the order in which things came', () => {
    const inbox = new MeshInbox();
    inbox.push(parcel('actor', 0, 1));
    inbox.push(parcel('room'));
    inbox.push(parcel('object', 4));
    inbox.push(parcel('object', 5));
    inbox.push(parcel('actor', 0, 2));
    const taken = [inbox.take(), inbox.take(), inbox.take(), inbox.take(), inbox.take()];
    expect(taken.map((one) => one && `${one.stream} ${one.id}`)).toEqual([
      'actor 0',
      'room 0',
      'object 4',
      'object 5',
      null,
    ]);
    expect(taken[0]?.mesh[0]).toBe(2);
    expect(inbox.superseded).toBe(1);
  });

  it('stays bounded, whatever ids are sent', () => {
    const inbox = new MeshInbox();
    for (let id = 1; id <= 10_000; ++id) inbox.push(parcel('object', id));
    let kept = 0;
    while (inbox.take() !== null) kept += 1;
    expect(kept).toBe(258);
  });
});
