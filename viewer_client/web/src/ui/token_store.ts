// SPDX-License-Identifier: Apache-2.0

const kKey = 'mixstage-token';

// The token lives as long as this tab, and nowhere else. A browser that keeps nothing asks again after a reload.

export function storedToken(): string | null {
  try {
    return sessionStorage.getItem(kKey);
  } catch {
    return null;
  }
}

export function storeToken(token: string | null): void {
  try {
    if (token === null) sessionStorage.removeItem(kKey);
    else sessionStorage.setItem(kKey, token);
  } catch {
    // Storage is switched off: nothing to forget either.
  }
}
