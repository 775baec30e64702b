// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { wantedStreams } from './wanted_streams';

describe('the streams asked for', () => {
  it.each([
    [1, 1, 1, 0, 'matte', ['color', 'depth']],
    [1, 0, 0, 0, 'matte', ['color']],
    [0, 1, 0, 0, 'matte', ['depth']],
    [0, 0, 1, 0, 'matte', ['color', 'depth']],
    [0, 0, 1, 0, 'label', ['depth']],
    [0, 0, 0, 0, 'matte', []],
    [0, 0, 0, 1, 'matte', ['mesh']],
    [1, 1, 1, 1, 'label', ['color', 'depth', 'mesh']],
    [0, 0, 1, 0, 'light', ['light']],
    [1, 1, 1, 1, 'light', ['color', 'depth', 'mesh', 'light']],
    [1, 0, 0, 0, 'light', ['color']],
  ] as const)(
    'program %i, depth %i, matte %i, 3D %i in mode %s',
    (program, depth, matte, room, mode, wanted) => {
      expect(wantedStreams({ pane_px: { program, depth, matte, room }, mode })).toEqual(wanted);
    },
  );
});
