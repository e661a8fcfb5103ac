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

/** Does what a key stands for and says whether it stands for anything. */
export function pressKey(event: KeyboardEvent, actions: KeyActions): boolean {
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  const arrow = ARROWS[event.key];
  if (arrow) {
    if (event.shiftKey) actions.pan(...arrow);
    else actions.turn(...arrow);
    return true;
  }
  switch (event.key) {
    case "+":
    case "=":
      actions.zoom(1);
      return true;
    case "-":
    case "_":
      actions.zoom(-1);
      return true;
    case "Home":
      actions.fit();
      return true;
    case "Escape":
      actions.clear();
      return true;
    case "n":
    case "]":
      actions.step(1);
      return true;
    case "N":
    case "[":
      actions.step(-1);
      return true;
    case "Enter":
      actions.pick();
      return true;
    default:
      return false;
  }
}
