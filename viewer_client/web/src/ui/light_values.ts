// SPDX-License-Identifier: Apache-2.0
import type { Vector3 } from '../transport/scene';

export const kSliderSteps = 200;
const kMostIntensity = 1000;
// The slider is a decade a quarter: what is seen of a light goes with its ratio. Its first step is off.
const kLeastIntensity = 0.01;

/** Intensity of a step of the slider, to three digits. */
export function intensityAt(step: number): number {
  if (step <= 0) return 0;
  const decades = Math.log10(kMostIntensity / kLeastIntensity);
  const value = kLeastIntensity * 10 ** ((decades * (step - 1)) / (kSliderSteps - 1));
  return Number(Math.min(kMostIntensity, value).toPrecision(3));
}

export function sliderAt(intensity: number): number {
  if (intensity < kLeastIntensity / 2) return 0;
  const decades = Math.log10(kMostIntensity / kLeastIntensity);
  const at = Math.log10(Math.max(intensity, kLeastIntensity) / kLeastIntensity) / decades;
  return Math.min(kSliderSteps, Math.round(1 + at * (kSliderSteps - 1)));
}

function encoded(linear: number): number {
  const value = Math.min(1, Math.max(0, linear));
  return value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055;
}

function decoded(value: number): number {
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}

/** Linear light 0..1 as the browser's #rrggbb, which is sRGB. */
export function hexOfLinear(color: Vector3): string {
  return `#${color
    .map((part) =>
      Math.round(255 * encoded(part))
        .toString(16)
        .padStart(2, '0'),
    )
    .join('')}`;
}

/** To four digits: more than eight bits say. */
export function linearOfHex(hex: string): Vector3 {
  const part = (at: number): number =>
    Number(decoded((Number.parseInt(hex.slice(at, at + 2), 16) || 0) / 255).toFixed(4));
  return [part(1), part(3), part(5)];
}
