// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { shortcutFor, type KeyPress, type Shortcut } from './shortcuts';

function shortcut(label: string, part: Partial<Shortcut> & { key: string }): Shortcut {
  return { label, does: '', run: () => undefined, ...part };
}

const kShortcuts = [
  shortcut('undo', { key: 'z', ctrl: true, shift: false }),
  shortcut('redo', { key: 'z', ctrl: true, shift: true }),
  shortcut('save', { key: 's', ctrl: true }),
  shortcut('drop', { key: 'd' }),
  shortcut('turn', { key: '[', repeats: true }),
  shortcut('delete', { key: 'Delete' }),
];

function pressed(key: string, part: Partial<KeyPress> = {}): string | null {
  const none = {
    ctrlKey: false,
    metaKey: false,
    altKey: false,
    shiftKey: false,
    repeat: false,
    altGraph: false,
  };
  return shortcutFor({ key, ...none, ...part }, kShortcuts)?.label ?? null;
}

describe('shortcuts', () => {
  it('tell undo from redo by Shift, with Ctrl and with Command', () => {
    expect(pressed('z', { ctrlKey: true })).toBe('undo');
    expect(pressed('Z', { ctrlKey: true, shiftKey: true })).toBe('redo');
    expect(pressed('z', { metaKey: true })).toBe('undo');
    expect(pressed('z')).toBeNull();
  });

  it('leave the browser its own keys', () => {
    expect(pressed('d', { ctrlKey: true })).toBeNull();
    expect(pressed('d', { altKey: true })).toBeNull();
    expect(pressed('d')).toBe('drop');
    expect(pressed('Delete')).toBe('delete');
  });

  it('find brackets that are written with AltGr', () => {
    expect(pressed('[', { ctrlKey: true, altKey: true, altGraph: true })).toBe('turn');
    expect(pressed('[')).toBe('turn');
  });

  it('repeat only what is meant to be held', () => {
    expect(pressed('[', { repeat: true })).toBe('turn');
    expect(pressed('z', { ctrlKey: true, repeat: true })).toBeNull();
  });
});
