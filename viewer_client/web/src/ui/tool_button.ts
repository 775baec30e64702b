// SPDX-License-Identifier: Apache-2.0
import { el } from './dom';
import { icon, type IconName } from './icons';

/** A small button that is an icon with a name for those who do not see it. */
export function toolButton(name: IconName, testid: string, title: string): HTMLButtonElement {
  return el(
    'button',
    { class: 'tool', testid, attributes: { type: 'button', title, 'aria-label': title } },
    icon(name),
  );
}
