import { render } from "preact";
import { hello } from "../viewer";
render(<p>{hello()}</p>, document.body);
