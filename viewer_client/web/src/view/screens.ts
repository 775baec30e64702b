// SPDX-License-Identifier: Apache-2.0
import type { DepthRange } from '../decode/depth_code';
import type { DepthPicture } from '../decode/depth_picture';
import { readDepth, type ProbePoint, type ProbeReading } from './depth_probe';
import { DepthView } from './depth_view';
import { LabelView } from './label_view';
import { MatteView } from './matte_view';
import type { PictureName, Shown } from './messages';
import { ProgramView } from './program_view';
import { Surface } from './surface';

/** The three panes' pictures: which of them a new one changes, what is frozen, what stands under the pointer. */
export class Screens {
  readonly #program: ProgramView;
  readonly #depth: DepthView;
  readonly #matte_surface: Surface;
  readonly #matte = new MatteView();
  readonly #label = new LabelView();
  #shown: Shown;
  #latest: DepthPicture | null = null;
  #frozen: DepthPicture | null = null;
  #probe: ProbePoint | null = null;
  #matte_pictures = 0;

  constructor(canvases: Record<PictureName, OffscreenCanvas>, shown: Shown) {
    this.#program = new ProgramView(canvases.program);
    this.#depth = new DepthView(canvases.depth);
    this.#matte_surface = new Surface(canvases.matte, { alpha: false });
    this.#shown = shown;
  }

  /** Borrows the frame. */
  drawColor(frame: VideoFrame, number: bigint): void {
    const { pane_px, mode } = this.#shown;
    const { displayWidth: width, displayHeight: height } = frame;
    if (pane_px.program > 0) this.#program.draw(frame);
    if (pane_px.matte === 0 || mode !== 'matte') return;
    // Y'CbCr becomes RGB once: the program's canvas, where it is drawn, is the cheaper source.
    this.#matte.takeColor(
      pane_px.program > 0 ? this.#program.canvas : frame,
      width,
      height,
      number,
      pane_px.matte,
    );
    this.#countMatte(this.#matte.draw(this.#matte_surface));
  }

  /** Takes the picture over. */
  drawDepth(picture: DepthPicture): void {
    if (this.#latest !== this.#frozen) this.#latest?.release();
    this.#latest = picture;
    if (this.#frozen === null) this.#redrawDepth();
    const { pane_px, mode } = this.#shown;
    if (pane_px.matte === 0) return;
    if (mode === 'light') return;
    if (mode === 'label') return this.#drawLabel();
    this.#matte.takeCoverage(picture);
    this.#countMatte(this.#matte.draw(this.#matte_surface));
  }

  /** Borrows the picture. */
  drawLight(picture: ImageBitmap): void {
    const { pane_px, mode } = this.#shown;
    if (pane_px.matte === 0 || mode !== 'light') return;
    this.#matte_surface.resize(picture.width, picture.height);
    this.#matte_surface.context.drawImage(picture, 0, 0);
    this.#countMatte(true);
  }

  show(shown: Shown): void {
    this.#shown = shown;
    this.#redrawDepth();
    if (shown.pane_px.matte > 0 && shown.mode === 'label') this.#drawLabel();
  }

  /** The depth pane and what is read from it stand still; everything else goes on. */
  freeze(frozen: boolean): void {
    if (this.#frozen !== this.#latest) this.#frozen?.release();
    this.#frozen = frozen ? this.#latest : null;
    this.#redrawDepth();
  }

  probe(point: ProbePoint | null): void {
    this.#probe = point;
  }

  get reading(): ProbeReading | null {
    const picture = this.#frozen ?? this.#latest;
    return picture === null || this.#probe === null ? null : readDepth(picture, this.#probe);
  }

  /** Pictures that the matte pane has shown so far. */
  get matte_pictures(): number {
    return this.#matte_pictures;
  }

  get range(): DepthRange | null {
    return (this.#frozen ?? this.#latest)?.range ?? null;
  }

  get frozen_frame(): string | null {
    return this.#frozen?.frame.toString() ?? null;
  }

  /** The depth of an earlier connection says nothing about now. */
  forgetDepth(): void {
    if (this.#latest !== this.#frozen) this.#latest?.release();
    this.#latest = null;
    this.#matte.reset();
  }

  #redrawDepth(): void {
    const picture = this.#frozen ?? this.#latest;
    const pane_px = this.#shown.pane_px.depth;
    if (picture !== null && pane_px > 0) this.#depth.draw(picture, pane_px);
  }

  #drawLabel(): void {
    if (this.#latest === null) return;
    this.#label.draw(this.#latest, this.#matte_surface);
    this.#countMatte(true);
  }

  #countMatte(drawn: boolean): void {
    if (drawn) this.#matte_pictures += 1;
  }
}
