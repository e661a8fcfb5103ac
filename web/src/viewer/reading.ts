import type { NodeInfo } from "../model/node-info";

/** A length for people; the dash stands for one that is not known. */
function millimetres(value: number | null): string {
  return value === null ? "–" : `${value.toFixed(2).replace(/^-0\.00$/, "0.00")} mm`;
}

/** Name and value of what is read at a node, in order. */
export function readingOf(node: NodeInfo): [string, string][] {
  const rows: [string, string][] = [
    ["Upper", millimetres(node.upper_mm)],
    ["Lower", millimetres(node.lower_mm)],
    ["Total", millimetres(node.total_mm)],
  ];
  if (node.sd_mm !== null) rows.push(["Standard deviation", millimetres(node.sd_mm)]);
  if (node.radius_mm !== null) rows.push(["Ball radius", millimetres(node.radius_mm)]);
  if (node.difference !== null) {
    rows.push(["Difference", `${node.difference >= 0.005 ? "+" : ""}${millimetres(node.difference)}`]);
  }
  rows.push(["Position", `${node.position.map((x) => x.toFixed(1).replace("-0.0", "0.0")).join(", ")} mm`]);
  return rows;
}

export function headingOf({ i, j, label, figure }: NodeInfo): string {
  return `(${i}, ${j}) · label ${label}, figure ${figure}`;
}

/** For a screen reader: everything in one sentence. */
export function sentenceOf(node: NodeInfo): string {
  const rows = readingOf(node).map(([name, value]) => `${name} ${value === "–" ? "not known" : value}`);
  return `Node row ${node.i}, column ${node.j} of label ${node.label}, figure ${node.figure}. ${rows.join(". ")}.`;
}

export function distanceText({ straight, along }: { straight: number; along: number | null }): string {
  return along === null ? millimetres(straight) : `${millimetres(straight)} · along the sheet ${millimetres(along)}`;
}
