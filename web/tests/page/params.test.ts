import { expect, test } from "vitest";
import { assemble, type Field, fieldsOf, type Schema } from "../../src/page/params";

/** Every form that a parameter is described in. */
const SCHEMA: Schema = {
  type: "object",
  properties: {
    labels: { type: "array", items: { type: "integer" }, maxItems: 3 },
    grid: {
      oneOf: [
        {
          type: "object",
          properties: {
            rows: { type: "integer", minimum: 3, maximum: 200 },
            cols: { type: "integer", minimum: 3, maximum: 200 },
          },
        },
        { type: "string", enum: ["auto"] },
      ],
      default: { rows: 6, cols: 8 },
    },
    margin: { type: "number", minimum: 0, maximum: 0.4, default: 0.05 },
    neighbors: {
      oneOf: [
        { type: "string", enum: ["auto"] },
        { type: "object", properties: { k: { type: "integer", minimum: 3, maximum: 500 } } },
        { type: "object", properties: { epsilon_mm: { type: "number", minimum: 0.01, maximum: 1000 } } },
      ],
      default: "auto",
    },
    spacing_mm: { type: "number", minimum: 0.01, maximum: 1000 },
  },
};
const FIELDS = fieldsOf(SCHEMA);

function fieldOf(name: string): Field {
  const found = FIELDS.find((field) => field.name === name);
  if (found === undefined) throw new Error(name);
  return found;
}

/** Fills a field in the way that is called `label`. */
function filled(name: string, label: string, ...texts: string[]) {
  return { [name]: { variant: fieldOf(name).variants.findIndex((variant) => variant.label === label), texts } };
}

test("a form that nobody touched sends nothing", () => {
  expect(assemble(FIELDS, {})).toEqual({ params: {}, wrong: {} });
});

test("defaults stand in the form", () => {
  expect(fieldOf("grid").initial).toEqual({ variant: 0, texts: ["6", "8"] });
  expect(fieldOf("margin").initial).toEqual({ variant: 0, texts: ["0.05"] });
  expect(fieldOf("labels").variants.map(({ label }) => label)).toEqual(["not set", "these"]);
});

test("what was filled in is sent as the service reads it", () => {
  const form = {
    ...filled("labels", "these", "11, -3 7"),
    ...filled("grid", "auto"),
    ...filled("margin", "a number", "0,1"),
    ...filled("neighbors", "epsilon_mm", "4"),
    ...filled("spacing_mm", "a number", "2.5"),
  };
  const params = { labels: [11, -3, 7], grid: "auto", margin: 0.1, neighbors: { epsilon_mm: 4 }, spacing_mm: 2.5 };
  expect(assemble(FIELDS, form)).toEqual({ params, wrong: {} });
});

test.each([
  ["margin", "a number", ["0.5"]],
  ["margin", "a number", [""]],
  ["margin", "a number", ["much"]],
  ["grid", "rows and cols", ["6", "7.5"]],
  ["grid", "rows and cols", ["2", "8"]],
  ["neighbors", "k", ["501"]],
  ["labels", "these", ["1 2 3 4"]],
  ["labels", "these", ["0"]],
  ["labels", "these", [""]],
])("%s (%s: %s) is told to be wrong", (name, label, texts) => {
  const { params, wrong } = assemble(FIELDS, filled(name, label, ...texts));
  expect(Object.keys(wrong)).toEqual([name]);
  expect(params).toEqual({});
});
