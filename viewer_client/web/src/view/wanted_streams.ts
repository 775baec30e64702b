// SPDX-License-Identifier: Apache-2.0
import type { StreamName } from '../transport/picture_message';
import type { Shown } from './messages';

/** The streams that the visible panes are made of; what no pane shows is not sent. */
export function wantedStreams(shown: Shown): StreamName[] {
  const { pane_px, mode } = shown;
  const wanted: StreamName[] = [];
  if (pane_px.program > 0 || (pane_px.matte > 0 && mode === 'matte')) wanted.push('color');
  if (pane_px.depth > 0 || pane_px.matte > 0) wanted.push('depth');
  return wanted;
}
