// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { fit, kHead_px, layoutOf, type LayoutInput, type Rect } from './layout';

const kRail = { width: 264, height: 300 };
const kWindows = [
  [1264, 660],
  [1904, 1020],
  [1008, 708],
  [1164, 760],
  [3824, 2092],
  [800, 1200],
] as const;
const kCases = kWindows.flatMap(([width, height]) =>
  [4 / 3, 16 / 9].flatMap((aspect) =>
    [0, 1, 2].flatMap((pictures) =>
      [false, true].map((room): LayoutInput => ({ width, height, aspect, pictures, room, rail: kRail })),
    ),
  ),
);

function overlap(a: Rect, b: Rect): boolean {
  return a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
}

describe('the layout', () => {
  it.each(kCases)(
    '$width x $height, aspect $aspect, $pictures pictures, 3D $room: inside, apart, controls have room',
    (input) => {
      const { main, pictures, room, rail } = layoutOf(input);
      expect(pictures.length).toBe(input.pictures);
      expect(room !== null).toBe(input.room);
      const all = [main, ...pictures, ...(room === null ? [] : [room]), rail];
      for (const rect of all) {
        expect(rect.x).toBeGreaterThanOrEqual(0);
        expect(rect.y).toBeGreaterThanOrEqual(0);
        expect(rect.x + rect.width).toBeLessThanOrEqual(input.width + 1);
        expect(rect.y + rect.height).toBeLessThanOrEqual(input.height + 1);
      }
      for (const [index, rect] of all.entries())
        for (const other of all.slice(index + 1)) expect(overlap(rect, other)).toBe(false);
      expect(rail.width).toBeGreaterThanOrEqual(240);
      expect(rail.height).toBeGreaterThanOrEqual(kRail.height - 2);
    },
  );

  it.each(kCases)(
    '$width x $height, aspect $aspect, $pictures pictures, 3D $room: the main picture is the largest',
    (input) => {
      const { main, pictures, room } = layoutOf(input);
      const picture = fit(main.width, main.height - kHead_px, input.aspect);
      for (const pane of pictures)
        expect(picture.width).toBeGreaterThan(fit(pane.width, pane.height - kHead_px, input.aspect).width);
      if (room === null) return;
      expect(picture.width * picture.height).toBeGreaterThan(room.width * (room.height - kHead_px));
      expect(room.width).toBeGreaterThanOrEqual(200);
      expect(room.height).toBeGreaterThanOrEqual(160);
    },
  );

  it('gives a 4:3 picture the full height of a wide window', () => {
    const { arrangement, main } = layoutOf({
      width: 1904,
      height: 1020,
      aspect: 4 / 3,
      pictures: 2,
      room: true,
      rail: kRail,
    });
    expect(arrangement).toBe('beside');
    expect(fit(main.width, main.height - kHead_px, 4 / 3).height).toBeGreaterThanOrEqual(1020 - kHead_px - 2);
  });

  it('puts the strip below in a tall window', () => {
    expect(
      layoutOf({ width: 800, height: 1200, aspect: 4 / 3, pictures: 2, room: true, rail: kRail }).arrangement,
    ).toBe('below');
  });

  it('fits a picture into the middle on whole pixels', () => {
    expect(fit(101, 50, 2)).toEqual({ x: 0, y: 0, width: 100, height: 50 });
    expect(fit(100, 80, 2)).toEqual({ x: 0, y: 15, width: 100, height: 50 });
  });
});
