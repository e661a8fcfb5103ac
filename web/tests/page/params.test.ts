import { beforeAll, expect, test } from "vitest";
import { assemble, type Field, fieldsOf } from "../../src/page/params";
import { startService } from "../support/service";

let fields: Field[];

beforeAll(async () => {
  const service = await startService();
  const limits = await (await fetch(`${service.url}/v1/limits`)).json();
  fields = fieldsOf(limits.params);
  await service.stop();
});

function fieldOf(name: string): Field {
  const found = fields.find((field) => field.name === name);
  if (found === undefined) throw new Error(name);
  return found;
}

/** Fills a field in the way that is called `label`. */
function filled(name: string, label: string, ...texts: string[]) {
  return { [name]: { variant: fieldOf(name).variants.findIndex((variant) => variant.label === label), texts } };
}

test("a form that nobody touched sends nothing", () => {
  expect(assemble(fields, {})).toEqual({ params: {}, wrong: {} });
});

test("every parameter of the service has a field that says what it would take anyway", () => {
  expect(fields.length).toBeGreaterThan(10);
  for (const { name, about, variants, initial } of fields) {
    expect(variants.length, name).toBeGreaterThan(0);
    expect(about, name).not.toBe("");
    const untouched = variants[initial.variant];
    if (untouched?.kind === "number") expect(initial.texts[0], name).not.toBeUndefined();
  }
});

test("defaults stand in the form", () => {
  expect(fieldOf("grid").initial).toEqual({ variant: 1, texts: [] });
  expect(fieldOf("margin").variants.map(({ label }) => label)).toEqual(["not set", "a number"]);
  expect(fieldOf("labels").variants.map(({ label }) => label)).toEqual(["not set", "these"]);
  expect(fieldOf("embedding").initial).toEqual({ variant: 0, texts: [] });
  expect(fieldOf("names").initial).toEqual({ variant: 0, texts: [""] });
  const four = ["model.glb", "thickness.json", "thickness.csv", "points.csv"];
  expect(fieldOf("outputs").initial).toEqual({ variant: 0, texts: four });
});

test("what was filled in is sent as the service reads it", () => {
  const form = {
    ...filled("labels", "these", "11, -3 7"),
    ...filled("grid", "auto"),
    ...filled("margin", "a number", "0,1"),
    ...filled("neighbors", "epsilon_mm", "4"),
    ...filled("spacing_mm", "a number", "2.5"),
    ...filled("landmarks", "all"),
    ...filled("lattice", "regular"),
    ...filled("prune", "a number", "0.5"),
    ...filled("embedding", "lle"),
    ...filled("names", "these", "11: left: caudate\n\n -3 :rest "),
    ...filled("outputs", "these", "points.csv", "model.glb"),
  };
  const numbers = { labels: [11, -3, 7], margin: 0.1, neighbors: { epsilon_mm: 4 }, spacing_mm: 2.5, prune: 0.5 };
  const lists = { names: { 11: "left: caudate", "-3": "rest" }, outputs: ["model.glb", "points.csv"] };
  const params = { ...numbers, landmarks: "all", lattice: "regular", embedding: "lle", ...lists };
  expect(assemble(fields, form)).toEqual({ params, wrong: {} });
});

test.each([
  ["margin", "a number", ["0.5"]],
  ["margin", "a number", [""]],
  ["margin", "a number", ["much"]],
  ["grid", "rows and cols", ["6", "7.5"]],
  ["grid", "rows and cols", ["1", "8"]],
  ["landmarks", "a whole number", ["20,000"]],
  ["neighbors", "k", ["0"]],
  ["prune", "a number", ["1.5"]],
  ["labels", "these", ["0"]],
  ["labels", "these", [""]],
  ["labels", "these", ["11, 11"]],
  ["names", "these", ["left caudate"]],
  ["names", "these", ["0: background"]],
  ["names", "these", ["11: a\n11: b"]],
  ["names", "these", [`11: ${"x".repeat(81)}`]],
  ["outputs", "these", []],
])("%s (%s: %s) is told to be wrong", (name, label, texts) => {
  const { params, wrong } = assemble(fields, filled(name, label, ...texts));
  expect(Object.keys(wrong)).toEqual([name]);
  expect(params).toEqual({});
});
