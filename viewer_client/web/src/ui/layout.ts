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
  /** Panes beside the main one. */
  panes: number;
  /** What the controls need at least. */
  rail: { width: number; height: number };
}

export interface Layout {
  arrangement: 'beside' | 'below';
  main: Rect;
  panes: Rect[];
  rail: Rect;
}

/** Height of a pane's head; the style sheet has the same. */
export const kHead_px = 32;
export const kGap_px = 8;
/** Room of the depth scale at a picture's right. */
export const kScale_px = 72;
const kLeastPane_px = 248;

function pictureWidth(rect: Rect, aspect: number): number {
  return Math.max(0, Math.min(rect.width, (rect.height - kHead_px) * aspect));
}

/** The strip of small panes and controls stands at the right; the main picture takes the full height. */
function beside({ width, height, aspect, panes, rail }: LayoutInput): Layout {
  const full_width = (height - kHead_px) * aspect;
  const least = panes > 0 ? Math.max(kLeastPane_px + kScale_px, rail.width) : rail.width;
  const strip = Math.round(Math.max(least, Math.min(width - kGap_px - full_width, 0.4 * width)));
  const x = width - strip;
  const natural = kHead_px + strip / aspect;
  const share = (height - rail.height - panes * kGap_px) / Math.max(1, panes);
  const pane_height = Math.round(Math.max(kHead_px, Math.min(natural, share)));
  const rects = Array.from({ length: panes }, (_, index) => ({
    x,
    y: index * (pane_height + kGap_px),
    width: strip,
    height: pane_height,
  }));
  const rail_y = panes * (pane_height + kGap_px);
  return {
    arrangement: 'beside',
    main: { x: 0, y: 0, width: x - kGap_px, height },
    panes: rects,
    rail: { x, y: rail_y, width: strip, height: height - rail_y },
  };
}

/** The strip stands below; the main picture takes the full width. */
function below({ width, height, aspect, panes, rail }: LayoutInput): Layout {
  const full_height = kHead_px + width / aspect;
  const least = panes > 0 ? Math.max(kHead_px + kLeastPane_px / aspect, rail.height) : rail.height;
  const strip = Math.round(Math.max(least, Math.min(height - kGap_px - full_height, 0.5 * height)));
  const y = height - strip;
  const natural = kScale_px + (strip - kHead_px) * aspect;
  const share = (width - rail.width - panes * kGap_px) / Math.max(1, panes);
  const pane_width = Math.round(Math.min(natural, share));
  const rects = Array.from({ length: panes }, (_, index) => ({
    x: index * (pane_width + kGap_px),
    y,
    width: pane_width,
    height: strip,
  }));
  const rail_x = panes * (pane_width + kGap_px);
  return {
    arrangement: 'below',
    main: { x: 0, y: 0, width, height: y - kGap_px },
    panes: rects,
    rail: { x: rail_x, y, width: width - rail_x, height: strip },
  };
}

/** Places the panes so that the main picture is as large as the window allows; equal ones stand beside. */
export function layoutOf(input: LayoutInput): Layout {
  const first = beside(input);
  const second = below(input);
  return pictureWidth(second.main, input.aspect) > pictureWidth(first.main, input.aspect) ? second : first;
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
