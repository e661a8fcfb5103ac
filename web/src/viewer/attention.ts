import { type NodeInfo, nodeInfo, sameNode } from "../model/node-info";
import { figuresOf, type NodeRef, positionsOf, type Result, refOf } from "../model/result";
import type { Shown } from "./shown";

/** Which nodes are pointed at and picked. */
export class Attention {
  hovered: NodeInfo | null = null;
  /** 0 to 2: two are measured. */
  picks: NodeInfo[] = [];

  /** Says whether that is another node than before. */
  hover(result: Result, node: NodeRef | null): boolean {
    if (sameNode(this.hovered, node)) return false;
    const before = this.hovered;
    this.hovered = node && nodeInfo(result, node);
    return before !== this.hovered;
  }

  /** A picked node is let go of, a third one begins anew. Says whether anything changed. */
  pick(result: Result, node: NodeRef): boolean {
    const info = nodeInfo(result, node);
    if (!info) return false;
    const others = this.picks.filter((pick) => !sameNode(pick, info));
    if (others.length < this.picks.length) this.picks = others;
    else this.picks = others.length === 2 ? [info] : [...others, info];
    return true;
  }

  /** The node after the hovered one or before it, among those to be seen; round the end to the first. */
  neighbour(result: Result, shown: Shown, by: 1 | -1): NodeRef | null {
    const nodes = figuresOf(result)
      .filter(({ structure, index }) => shown.figure(structure, index))
      .flatMap((figure) => positionsOf(figure).flatMap((point, node) => (point ? [refOf(figure, node)] : [])));
    const at = nodes.findIndex((node) => sameNode(node, this.hovered));
    const next = at < 0 ? (by > 0 ? 0 : nodes.length - 1) : (at + by + nodes.length) % nodes.length;
    return nodes[next] ?? null;
  }

  /** The same nodes with the readings of another result of the same model. */
  refresh(result: Result): void {
    this.hovered = this.hovered && nodeInfo(result, this.hovered);
    this.picks = this.picks.flatMap((pick) => nodeInfo(result, pick) ?? []);
  }

  clear(): void {
    this.hovered = null;
    this.picks = [];
  }
}
