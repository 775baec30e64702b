// SPDX-License-Identifier: Apache-2.0
import { labelOf, type DepthPicture, type Label } from '../decode/depth_picture';
import { Raster } from './raster';
import { Surface } from './surface';
import { pixelWord } from './turbo';

/** sRGB of each label; the page's legend says the same. */
export const kLabelColors: Readonly<Record<Label, readonly [number, number, number]>> = {
  background: [0x2a, 0x2f, 0x36],
  actor: [0x3d, 0xdb, 0xb4],
  shadow: [0x5b, 0x7c, 0xe6],
  unknown: [0xe0, 0x6c, 0xb4],
};

/** What each pixel was taken for, in false colours. */
export class LabelView {
  readonly #raster = new Raster();
  readonly #words: Readonly<Record<Label, number>>;

  constructor() {
    const word = (label: Label): number => pixelWord(...kLabelColors[label]);
    this.#words = {
      background: word('background'),
      actor: word('actor'),
      shadow: word('shadow'),
      unknown: word('unknown'),
    };
  }

  /** Borrows the picture; draws at the planes' own size, half the picture's. */
  draw(picture: DepthPicture, surface: Surface): void {
    const { coverage, label } = picture;
    const out = this.#raster.words(label.width, label.height);
    let to = 0;
    for (let y = 0; y < label.height; ++y) {
      for (let x = 0; x < label.width; ++x) {
        const alpha4 = coverage.samples[y * coverage.stride + x] ?? 0;
        out[to++] = this.#words[labelOf(alpha4, label.samples[y * label.stride + x] ?? 0)];
      }
    }
    surface.resize(label.width, label.height);
    this.#raster.put(surface.context);
  }
}
