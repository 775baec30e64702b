// SPDX-License-Identifier: Apache-2.0

export interface Shortcut {
  /** As KeyboardEvent says it; letters in lower case. */
  key: string;
  /** With Ctrl, or the Command key of a Mac. */
  ctrl?: boolean;
  shift?: boolean;
  /** Goes on while the key is held. */
  repeats?: boolean;
  /** As the list of keys writes it. */
  label: string;
  /** Empty: the list of keys tells it elsewhere. */
  does: string;
  run: () => void;
}

export type KeyPress = Pick<
  KeyboardEvent,
  'key' | 'ctrlKey' | 'metaKey' | 'altKey' | 'shiftKey' | 'repeat'
> & {
  /** On many keyboards [ and ] are written with AltGr, which also says Ctrl and Alt. */
  altGraph: boolean;
};

/** The shortcut that a key means; null: none. */
export function shortcutFor(press: KeyPress, shortcuts: readonly Shortcut[]): Shortcut | null {
  const ctrl = !press.altGraph && (press.ctrlKey || press.metaKey);
  if (press.altKey && !press.altGraph) return null;
  const key = press.key.length === 1 ? press.key.toLowerCase() : press.key;
  const fits = (shortcut: Shortcut): boolean =>
    shortcut.key === key &&
    (shortcut.ctrl ?? false) === ctrl &&
    (shortcut.shift === undefined || shortcut.shift === press.shiftKey);
  const found = shortcuts.find(fits) ?? null;
  return press.repeat && found?.repeats !== true ? null : found;
}

/** Space on a button presses the button; typing into a field is typing. */
function keepsKey(target: EventTarget | null, key: string): boolean {
  if (!(target instanceof HTMLElement)) return false;
  // A slider takes no letters.
  if (target instanceof HTMLInputElement) return target.type !== 'range' || key.startsWith('Arrow');
  if (target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) return true;
  return target instanceof HTMLButtonElement && (key === ' ' || key === 'Enter');
}

/** `enabled` is asked for each key: a dialog that is open keeps the keys to itself. */
export function listenForShortcuts(
  shortcuts: readonly Shortcut[],
  enabled: (shortcut: Shortcut) => boolean,
): void {
  window.addEventListener('keydown', (event) => {
    if (event.defaultPrevented || keepsKey(event.target, event.key)) return;
    const { key, ctrlKey, metaKey, altKey, shiftKey, repeat } = event;
    const altGraph = event.getModifierState('AltGraph');
    const shortcut = shortcutFor({ key, ctrlKey, metaKey, altKey, shiftKey, repeat, altGraph }, shortcuts);
    if (shortcut === null || !enabled(shortcut)) return;
    event.preventDefault();
    shortcut.run();
  });
}
