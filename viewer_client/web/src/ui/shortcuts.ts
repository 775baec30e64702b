// SPDX-License-Identifier: Apache-2.0

export interface Shortcut {
  key: string;
  /** As the list of keys writes it. */
  label: string;
  does: string;
  run: () => void;
}

/** Space on a button presses the button; typing into a field is typing. */
function keepsKey(target: EventTarget | null, key: string): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target instanceof HTMLInputElement || target instanceof HTMLTextAreaElement) return true;
  return target instanceof HTMLButtonElement && (key === ' ' || key === 'Enter');
}

/** `enabled` is asked for each key: a dialog that is open keeps the keys to itself. */
export function listenForShortcuts(
  shortcuts: readonly Shortcut[],
  enabled: (shortcut: Shortcut) => boolean,
): void {
  const by_key = new Map(shortcuts.map((shortcut) => [shortcut.key, shortcut]));
  window.addEventListener('keydown', (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.repeat || keepsKey(event.target, event.key))
      return;
    const shortcut = by_key.get(event.key.length === 1 ? event.key.toLowerCase() : event.key);
    if (shortcut === undefined || !enabled(shortcut)) return;
    event.preventDefault();
    shortcut.run();
  });
}
