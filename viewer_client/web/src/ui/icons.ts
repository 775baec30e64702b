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
