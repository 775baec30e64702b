// SPDX-License-Identifier: Apache-2.0
import type { Vector3 } from '../transport/scene';
import { circle, project, type Viewpoint } from '../view/geometry';

const kNamespace = 'http://www.w3.org/2000/svg';
const kPoints = 48;

/** The shadow ring in pixels of a picture, as an SVG path; empty where none of it is seen. */
export function ringPath(view: Viewpoint, base: Vector3, radius_m: number, up: Vector3): string {
  const { width, height } = view.pinhole;
  const pixels = circle(base, radius_m, up, kPoints).map((point) => project(view, point));
  // A ring that reaches behind the camera would be drawn inside out.
  const seen = pixels.filter((pixel) => pixel !== null);
  if (seen.length < kPoints) return '';
  const inside = seen.some(({ u, v }) => u >= 0 && u < width && v >= 0 && v < height);
  return inside ? `M${seen.map(({ u, v }) => `${u.toFixed(1)} ${v.toFixed(1)}`).join('L')}Z` : '';
}

/** Drawn over the program: where the selected object stands. Lens distortion is left out: it guides, it does not measure. */
export class RingOverlay {
  readonly root = document.createElementNS(kNamespace, 'svg');
  readonly #ground = document.createElementNS(kNamespace, 'path');
  readonly #line = document.createElementNS(kNamespace, 'path');

  constructor() {
    this.root.setAttribute('class', 'ring');
    this.root.setAttribute('aria-hidden', 'true');
    this.root.dataset['testid'] = 'shadow-ring';
    this.root.setAttribute('preserveAspectRatio', 'none');
    this.#ground.setAttribute('class', 'ring-ground');
    this.#line.setAttribute('class', 'ring-line');
    this.root.append(this.#ground, this.#line);
    this.show(null, null, 0, [0, 0, 1]);
  }

  show(view: Viewpoint | null, base: Vector3 | null, radius_m: number, up: Vector3): void {
    const path = view === null || base === null ? '' : ringPath(view, base, radius_m, up);
    this.root.style.display = path === '' ? 'none' : '';
    if (view === null || path === '') return;
    const { width, height } = view.pinhole;
    // Pixel centres are whole numbers: the picture begins half a pixel before them.
    this.root.setAttribute('viewBox', `-0.5 -0.5 ${width} ${height}`);
    this.#ground.setAttribute('d', path);
    this.#line.setAttribute('d', path);
  }
}
