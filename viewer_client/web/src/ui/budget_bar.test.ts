// SPDX-License-Identifier: Apache-2.0
import { describe, expect, it } from 'vitest';
import { budgetBar } from './budget_bar';

const stage = (
  name: string,
  wall_ms: number,
  budget_ms = 100,
): { name: string; wall_ms: number; budget_ms: number; cpu_ms: number } => ({
  name,
  wall_ms,
  budget_ms,
  cpu_ms: 0,
});

describe('the budget bar', () => {
  it('stacks stages end to end against 33 ms', () => {
    const bar = budgetBar([stage('a', 11), stage('b', 5.5)]);
    expect(bar.segments.map(({ from, width }) => [from, width])).toEqual([
      [0, 1 / 3],
      [1 / 3, 1 / 6],
    ]);
    expect([bar.total_ms, bar.budget_at]).toEqual([16.5, 1]);
  });

  it('grows past the budget and shows where that is', () => {
    const bar = budgetBar([stage('a', 44), stage('b', 22)]);
    expect(bar.budget_at).toBe(0.5);
    expect(bar.segments.reduce((sum, { width }) => sum + width, 0)).toBeCloseTo(1, 12);
  });

  it('marks a stage over its own budget; one without a budget never is', () => {
    expect(
      budgetBar([stage('a', 3, 2.9), stage('b', 3, 3), stage('c', 9, 0)]).segments.map(({ over }) => over),
    ).toEqual([true, false, false]);
  });

  it('is empty without stages', () =>
    expect(budgetBar([])).toMatchObject({ segments: [], total_ms: 0, scale_ms: 33 }));
});
