// SPDX-License-Identifier: Apache-2.0

export interface Rect {
  x: number;
  y: number;
  width: number;
  height: number;
}

export interface LayoutInput {
  width: number;
  height: number;
  /** Of the picture, width by height. */
  aspect: number;
  /** Pictures beside the main one: 0 to 2. */
  pictures: number;
  /** Whether the 3D view stands beside the main picture: it takes any shape. */
  room: boolean;
  /** What the controls need at least. */
  rail: { width: number; height: number };
}

export interface Layout {
  arrangement: 'beside' | 'below';
  main: Rect;
  pictures: Rect[];
  room: Rect | null;
  rail: Rect;
}

/** Height of a pane's head; the style sheet has the same. */
export const kHead_px = 32;
export const kGap_px = 8;
/** Room of the depth scale at a picture's right. */
export const kScale_px = 72;
const kLeastPane_px = 240;
const kLeastRoom_px = 200;
// On a wall of pixels the small panes grow with the large one.
const kLeastStripWidth = 0.25;
const kLeastStripHeight = 0.18;
// From this height a strip below the main picture is more than one row.
const kManyRows_px = 480;
const kRoomShare = 0.5;

function pictureWidth(rect: Rect, aspect: number): number {
  return Math.max(0, Math.min(rect.width, (rect.height - kHead_px) * aspect));
}

/** Cuts a rectangle into `count` equal ones in a row, a gap between. */
function inRow({ x, y, width, height }: Rect, count: number): Rect[] {
  const each = (width - (count - 1) * kGap_px) / Math.max(1, count);
  return Array.from({ length: count }, (_, index) => {
    const from = Math.round(index * (each + kGap_px));
    return { x: x + from, y, width: Math.round(each), height };
  });
}

type Strip = Pick<Layout, 'pictures' | 'room' | 'rail'>;

/** What is left of a strip below its pictures: the 3D view and the controls, side by side or one above the other. */
function foot(strip: Rect, { room, rail }: LayoutInput): Pick<Layout, 'room' | 'rail'> {
  if (!room) return { room: null, rail: strip };
  const view_height = strip.height - rail.height - kGap_px;
  const [left, right] = inRow(strip, 2);
  // Side by side both are high and narrow: only where the 3D view would else be a slit, or the list would be.
  if (view_height < kLeastRoom_px && left !== undefined && right !== undefined) {
    return { room: left, rail: right };
  }
  const height = Math.round(Math.max(kLeastRoom_px, Math.min(view_height, kRoomShare * strip.height)));
  const y = strip.y + height + kGap_px;
  return {
    room: { ...strip, height },
    rail: { ...strip, y, height: strip.height - height - kGap_px },
  };
}

/** Pictures side by side at the strip's head. */
function rowStrip(strip: Rect, input: LayoutInput): Strip {
  if (input.pictures === 0) return { pictures: [], ...foot(strip, input) };
  const [first] = inRow(strip, input.pictures);
  const natural = kHead_px + (first?.width ?? 0) / input.aspect;
  const height = Math.round(Math.min(natural, strip.height - input.rail.height - kGap_px));
  const y = strip.y + height + kGap_px;
  return {
    pictures: inRow({ ...strip, height }, input.pictures),
    ...foot({ ...strip, y, height: strip.height - height - kGap_px }, input),
  };
}

/** Pictures one above the other. */
function columnStrip(strip: Rect, input: LayoutInput): Strip {
  const { aspect, pictures, rail } = input;
  const kept = rail.height + pictures * kGap_px;
  const natural = kHead_px + (strip.width - kScale_px) / aspect;
  const height = Math.round(
    Math.max(kHead_px, Math.min(natural, (strip.height - kept) / Math.max(1, pictures))),
  );
  const taken = pictures * (height + kGap_px);
  return {
    pictures: Array.from({ length: pictures }, (_, index) => ({
      ...strip,
      y: strip.y + index * (height + kGap_px),
      height,
    })),
    ...foot({ ...strip, y: strip.y + taken, height: strip.height - taken }, input),
  };
}

/** The way that shows the pictures larger; in a column there would be but a slit left for the 3D view. */
function stripOf(strip: Rect, input: LayoutInput): Strip {
  const row = rowStrip(strip, input);
  if (input.room) return row;
  const column = columnStrip(strip, input);
  const size = ({ pictures: [first] }: Strip): number =>
    first === undefined ? 0 : pictureWidth({ ...first, width: first.width - kScale_px }, input.aspect);
  return size(column) > size(row) ? column : row;
}

/** The strip of small panes and controls stands at the right; the main picture takes the full height. */
function beside(input: LayoutInput): Layout {
  const { width, height, aspect, pictures, room, rail } = input;
  const full_width = (height - kHead_px) * aspect;
  const panes = pictures + Number(room);
  const needs = panes >= 2 ? 2 * kLeastPane_px + kGap_px : panes * (kLeastPane_px + kScale_px);
  const least = Math.max(rail.width, needs, pictures > 0 ? kLeastStripWidth * width : 0);
  const strip = Math.round(Math.max(least, Math.min(width - kGap_px - full_width, 0.4 * width)));
  const x = width - strip;
  return {
    arrangement: 'beside',
    main: { x: 0, y: 0, width: x - kGap_px, height },
    ...stripOf({ x, y: 0, width: strip, height }, input),
  };
}

/** The small panes stand in a row below the main picture, the controls at the right of both. */
function belowAndRail(input: LayoutInput): Layout {
  const width = input.width - input.rail.width - kGap_px;
  const { main, pictures, room } = below({ ...input, width, rail: { width: -kGap_px, height: 0 } });
  const rail = { x: width + kGap_px, y: 0, width: input.rail.width, height: input.height };
  return { arrangement: 'below', main, pictures, room, rail };
}

/** Small panes and controls stand in one row below; the main picture takes the full width. */
function below(input: LayoutInput): Layout {
  const { width, height, aspect, pictures, room, rail } = input;
  const panes = pictures + Number(room);
  const full_height = kHead_px + width / aspect;
  const least_row = Math.max(kHead_px + kLeastPane_px / aspect, kLeastStripHeight * height);
  const least = panes > 0 ? Math.max(least_row, rail.height) : rail.height;
  const strip = Math.round(Math.max(least, Math.min(height - kGap_px - full_height, 0.5 * height)));
  const main_height = strip === 0 ? height : height - strip - kGap_px;
  const y = height - strip;
  const main = { x: 0, y: 0, width, height: main_height };
  if (strip >= kManyRows_px)
    return { arrangement: 'below', main, ...stripOf({ x: 0, y, width, height: strip }, input) };
  const row = { x: 0, y, width: width - rail.width - kGap_px, height: strip };
  const rects = inRow(row, panes);
  const rail_x = panes === 0 ? 0 : width - rail.width;
  return {
    arrangement: 'below',
    main,
    pictures: rects.slice(0, pictures),
    room: room ? (rects[pictures] ?? null) : null,
    rail: { x: rail_x, y, width: width - rail_x, height: strip },
  };
}

/** Places the panes so that the main picture is as large as the window allows; the earlier of equal ones is taken. */
export function layoutOf(input: LayoutInput): Layout {
  return [beside(input), belowAndRail(input), below(input)].reduce((best, next) =>
    pictureWidth(next.main, input.aspect) > pictureWidth(best.main, input.aspect) ? next : best,
  );
}

/** The largest rectangle of an aspect inside width x height, centred, on whole pixels. */
export function fit(width: number, height: number, aspect: number): Rect {
  const fitted = Math.max(0, Math.floor(Math.min(width, height * aspect)));
  const fitted_height = Math.floor(fitted / aspect);
  return {
    x: Math.floor((width - fitted) / 2),
    y: Math.floor((height - fitted_height) / 2),
    width: fitted,
    height: fitted_height,
  };
}
