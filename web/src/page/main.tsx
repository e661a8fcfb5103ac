import "./page.css";
import { begin } from "./app";

begin();
