export interface KeyActions {
  /** Steps of the arrows: to the right and upward. */
  turn(right: number, upward: number): void;
  pan(right: number, upward: number): void;
  /** Above 0: closer. */
  zoom(steps: number): void;
  fit(): void;
  clear(): void;
  /** To the next node or the one before. */
  step(by: 1 | -1): void;
  pick(): void;
}

/** For the description of the picture. */
export const KEYS_HELP =
  "Arrow keys turn the model, with Shift they move it. Plus and minus zoom, Home shows everything. " +
  "N and Shift N, or the brackets, go from node to node and read it out. Enter picks the node, two picks measure, " +
  "Escape clears.";

const ARROWS: Readonly<Record<string, readonly [number, number]>> = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, 1],
  ArrowDown: [0, -1],
};

const KEYS: Readonly<Record<string, (actions: KeyActions) => void>> = {
  "+": (actions) => actions.zoom(1),
  "=": (actions) => actions.zoom(1),
  "-": (actions) => actions.zoom(-1),
  _: (actions) => actions.zoom(-1),
  Home: (actions) => actions.fit(),
  Escape: (actions) => actions.clear(),
  n: (actions) => actions.step(1),
  "]": (actions) => actions.step(1),
  N: (actions) => actions.step(-1),
  "[": (actions) => actions.step(-1),
  Enter: (actions) => actions.pick(),
};

/** Does what a key stands for and says whether it stands for anything. */
export function pressKey(event: KeyboardEvent, actions: KeyActions): boolean {
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  const arrow = ARROWS[event.key];
  if (arrow && event.shiftKey) actions.pan(...arrow);
  else if (arrow) actions.turn(...arrow);
  else {
    const act = KEYS[event.key];
    act?.(actions);
    return act !== undefined;
  }
  return true;
}
