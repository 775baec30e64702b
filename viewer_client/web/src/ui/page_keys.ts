// SPDX-License-Identifier: Apache-2.0
import type { MatteMode, PaneName } from '../view/messages';
import type { Editor } from './editor';
import type { Shortcut } from './shortcuts';

/** What the keys reach of the page. */
export interface PageActions {
  togglePane(name: PaneName): void;
  setMode(mode: MatteMode): void;
  toggleFreeze(): void;
  toggleFollow(): void;
  toggleDetails(): void;
  toggleHelp(): void;
  openAdd(): void;
  /** Closes what is open, else lets go of what is selected. */
  escape(): void;
}

const kTurn_deg = 15;
const kTurnFine_deg = 1;

function show(name: PaneName, key: string, title: string, actions: PageActions): Shortcut {
  return { key, label: key, does: `Show or hide the ${title} pane`, run: () => actions.togglePane(name) };
}

/** Keys of whoever watches. */
export function viewKeys(actions: PageActions): Shortcut[] {
  return [
    show('program', '1', 'program', actions),
    show('depth', '2', 'depth', actions),
    show('matte', '3', 'matte', actions),
    show('room', '4', '3D', actions),
    {
      key: 'm',
      label: 'M',
      does: 'Matte: the actor over a checkerboard',
      run: () => actions.setMode('matte'),
    },
    {
      key: 'l',
      label: 'L',
      does: 'Label: what each pixel was taken for',
      run: () => actions.setMode('label'),
    },
    {
      key: 'k',
      label: 'K',
      does: 'Light map: the shadows of virtual objects on white',
      run: () => actions.setMode('light'),
    },
    {
      key: ' ',
      label: 'Space',
      does: 'Freeze the depth map, or let it go on',
      run: () => actions.toggleFreeze(),
    },
    { key: 'f', label: 'F', does: '3D view follows the camera', run: () => actions.toggleFollow() },
    { key: 'i', label: 'I', does: 'Details: times, drops, agents', run: () => actions.toggleDetails() },
    { key: '?', label: '?', does: 'This list', run: () => actions.toggleHelp() },
    { key: 'Escape', label: 'Esc', does: 'Close what is open, or let go', run: () => actions.escape() },
  ];
}

/** Keys of a director's hand. */
export function editKeys(editor: Editor, actions: PageActions): Shortcut[] {
  const turn = (key: string, angle_deg: number, does = ''): Shortcut => ({
    key,
    repeats: true,
    label: '[ ]',
    does,
    run: () => editor.turn(angle_deg),
  });
  return [
    { key: 'a', label: 'A', does: 'Add an object', run: () => actions.openAdd() },
    turn('[', kTurn_deg, 'Turn the selected object by 15° (Shift: 1°)'),
    turn(']', -kTurn_deg),
    // Shift writes other signs with these keys; where it does not, Shift is told by itself.
    turn('{', kTurnFine_deg),
    turn('}', -kTurnFine_deg),
    {
      key: 'd',
      label: 'D',
      does: 'Drop it to what is below',
      run: () => editor.doSelected(({ id }) => ({ op: 'drop', object: id })),
    },
    {
      key: 'Delete',
      label: 'Del',
      does: 'Delete it',
      run: () => editor.doSelected(({ id }) => ({ op: 'delete', object: id })),
    },
    {
      key: 'z',
      ctrl: true,
      shift: false,
      label: 'Ctrl Z',
      does: 'Undo (with Shift: redo)',
      run: () => editor.do({ op: 'undo' }),
    },
    { key: 'z', ctrl: true, shift: true, label: '', does: '', run: () => editor.do({ op: 'redo' }) },
    { key: 's', ctrl: true, label: 'Ctrl S', does: 'Save the scene', run: () => editor.do({ op: 'save' }) },
  ];
}
