// SPDX-License-Identifier: Apache-2.0

const kNamespace = 'http://www.w3.org/2000/svg';

// Strokes on a 16 x 16 grid.
const kPaths = {
  brand: 'M2 12.5 8 2l6 10.5M4.6 9.5h6.8',
  details: 'M2.5 13.5v-4M6.2 13.5v-8M9.8 13.5v-5M13.5 13.5v-11',
  help: 'M5.8 6.2a2.2 2.2 0 1 1 3.3 1.9c-.7.4-1.1.9-1.1 1.7M8 12.4v.1',
  close: 'M4 4l8 8M12 4l-8 8',
  pause: 'M5.5 3.5v9M10.5 3.5v9',
  play: 'M5 3.2v9.6l7.6-4.8z',
  add: 'M8 3v10M3 8h10',
  shown:
    'M1.5 8S4 3.8 8 3.8 14.5 8 14.5 8 12 12.2 8 12.2 1.5 8 1.5 8zM8 9.8a1.8 1.8 0 1 0 0-3.6 1.8 1.8 0 0 0 0 3.6z',
  hidden:
    'M2 2l12 12M6.2 4.1A7 7 0 0 1 8 3.8c4 0 6.5 4.2 6.5 4.2a12 12 0 0 1-2.1 2.5M4.2 5.3A11.5 11.5 0 0 0 1.5 8S4 12.2 8 12.2a6.5 6.5 0 0 0 2.9-.7',
  move: 'M8 1.5v13M1.5 8h13M6 3.5l2-2 2 2M6 12.5l2 2 2-2M3.5 6l-2 2 2 2M12.5 6l2 2-2 2',
  trash: 'M3 4.5h10M6.5 4.5v-2h3v2M4.5 4.5l.6 9h5.8l.6-9M6.8 7v4M9.2 7v4',
  undo: 'M6 3.5L2.5 7 6 10.5M2.5 7h7a3.5 3.5 0 0 1 0 7H7',
  redo: 'M10 3.5L13.5 7 10 10.5M13.5 7h-7a3.5 3.5 0 0 0 0 7H9',
  save: 'M3 2.5h8l2.5 2.5v8.5H3zM5.5 2.5V6h5V2.5M5.5 13.5V9.5h5v4',
  follow: 'M2 5.5h8v6H2zM10 7.5l4-2v6l-4-2',
  user: 'M8 8a2.7 2.7 0 1 0 0-5.4A2.7 2.7 0 0 0 8 8zM2.8 14c.4-2.7 2.5-4.2 5.2-4.2s4.8 1.5 5.2 4.2',
} as const;

export type IconName = keyof typeof kPaths;

/** Decoration beside a label: hidden from screen readers. */
export function icon(name: IconName): SVGSVGElement {
  const svg = document.createElementNS(kNamespace, 'svg');
  svg.setAttribute('viewBox', '0 0 16 16');
  svg.setAttribute('class', 'icon');
  svg.setAttribute('aria-hidden', 'true');
  const path = document.createElementNS(kNamespace, 'path');
  path.setAttribute('d', kPaths[name]);
  svg.append(path);
  return svg;
}

const kCross = 'M2 12.5h8M15 12.5h8M12.5 2v8M12.5 15v8';

/** A cross that leaves the pixel itself free; white on black, so that it is seen on any picture. */
export function cross(): SVGSVGElement {
  const svg = document.createElementNS(kNamespace, 'svg');
  svg.setAttribute('viewBox', '0 0 25 25');
  svg.setAttribute('aria-hidden', 'true');
  for (const name of ['cross-ground', 'cross-line']) {
    const path = document.createElementNS(kNamespace, 'path');
    path.setAttribute('class', name);
    path.setAttribute('d', kCross);
    svg.append(path);
  }
  return svg;
}
