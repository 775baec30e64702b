// SPDX-License-Identifier: Apache-2.0
import type { StageTime } from '../transport/stats';

export const kFrameBudget_ms = 33;

export interface BudgetSegment {
  name: string;
  wall_ms: number;
  /** Left edge and width as parts of the bar. */
  from: number;
  width: number;
  over: boolean;
}

export interface BudgetBar {
  segments: BudgetSegment[];
  total_ms: number;
  /** What the whole bar stands for: the budget, or the total when that is more. */
  scale_ms: number;
  /** Where the budget's line stands. */
  budget_at: number;
}

/** Stage times as a stacked bar against the 33 ms that a frame has. */
export function budgetBar(stages: readonly StageTime[]): BudgetBar {
  const total_ms = stages.reduce((sum, stage) => sum + stage.wall_ms, 0);
  const scale_ms = Math.max(kFrameBudget_ms, total_ms);
  let from_ms = 0;
  const segments = stages.map((stage) => {
    const segment = {
      name: stage.name,
      wall_ms: stage.wall_ms,
      from: from_ms / scale_ms,
      width: stage.wall_ms / scale_ms,
      over: stage.budget_ms > 0 && stage.wall_ms > stage.budget_ms,
    };
    from_ms += stage.wall_ms;
    return segment;
  });
  return { segments, total_ms, scale_ms, budget_at: kFrameBudget_ms / scale_ms };
}
