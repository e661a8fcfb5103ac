import type { NodeInfo } from "../model/node-info";
import type { ResultStructure } from "../model/result";
import type { FigureKind } from "../model/thickness";

/** A length for people; the dash stands for one that is not known. */
function millimetres(value: number | null): string {
  return value === null ? "–" : `${value.toFixed(2).replace(/^-0\.00$/, "0.00")} mm`;
}

/** Name and value of what is read at a node, in order. */
export function readingOf(node: NodeInfo): [string, string][] {
  const rows = lengthsOf(node);
  if (node.sd_mm !== null) rows.push(["Standard deviation", millimetres(node.sd_mm)]);
  if (node.radius_mm !== null) rows.push(["Ball radius", millimetres(node.radius_mm)]);
  if (node.difference !== null) {
    rows.push(["Difference", `${node.difference >= 0.005 ? "+" : ""}${millimetres(node.difference)}`]);
  }
  rows.push(["Position", `${node.position.map((x) => x.toFixed(1).replace("-0.0", "0.0")).join(", ")} mm`]);
  return rows;
}

function lengthsOf({ kind, upper_mm, lower_mm, wall_mm, total_mm }: NodeInfo): [string, string][] {
  if (kind === "tube") {
    return [
      ["Wall", millimetres(wall_mm)],
      ["Total", millimetres(total_mm)],
    ];
  }
  return [
    ["Upper", millimetres(upper_mm)],
    ["Lower", millimetres(lower_mm)],
    ["Total", millimetres(total_mm)],
  ];
}

/** Which structure has nothing but its object, and why. */
export function refusalOf({ label, refusal }: ResultStructure): [string, string] {
  return [`Label ${label} was refused`, refusal ?? ""];
}

export function headingOf({ i, j, label, figure }: NodeInfo): string {
  return `(${i}, ${j}) · label ${label}, figure ${figure}`;
}

/** For a screen reader: everything in one sentence. */
export function sentenceOf(node: NodeInfo): string {
  const rows = readingOf(node).map(([name, value]) => `${name} ${value === "–" ? "not known" : value}`);
  return `Node row ${node.i}, column ${node.j} of label ${node.label}, figure ${node.figure}. ${rows.join(". ")}.`;
}

/** `kind` is that of the figure that both nodes are on, where there is a way along it. */
export function distanceText(
  { straight, along }: { straight: number; along: number | null },
  kind: FigureKind,
): string {
  if (along === null) return millimetres(straight);
  return `${millimetres(straight)} · along the ${kind === "tube" ? "wall" : "sheet"} ${millimetres(along)}`;
}
