// SPDX-License-Identifier: Apache-2.0
import type { Subscription } from '../transport/control_message';
import type { Shown } from './messages';

/** The streams that the visible panes are made of; what no pane shows is not sent. */
export function wantedStreams(shown: Shown): Subscription[] {
  const { pane_px, mode } = shown;
  const wanted: Subscription[] = [];
  if (pane_px.program > 0 || (pane_px.matte > 0 && mode === 'matte')) wanted.push('color');
  if (pane_px.depth > 0 || (pane_px.matte > 0 && mode !== 'light')) wanted.push('depth');
  if (pane_px.room > 0) wanted.push('mesh');
  if (pane_px.matte > 0 && mode === 'light') wanted.push('light');
  return wanted;
}
