// The page: which view is shown, and the colors.

import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import type { About } from "./api";
import { Notice, useGet } from "./kit";
import { Data } from "./data";
import { Play } from "./play";
import { Results } from "./results";
import { Run } from "./run";

const VIEWS = ["play", "data", "run", "results"] as const;
type View = (typeof VIEWS)[number];

/** `#data?id=0` is a view with its state, so that pages can be bookmarked and the back key works. */
export interface Place { view: View; query: URLSearchParams }

function place(): Place {
  const [view, query] = location.hash.slice(1).split("?");
  return { view: VIEWS.find((known) => known === view) ?? "play", query: new URLSearchParams(query) };
}

const THEMES = ["auto", "light", "dark"];

function useTheme(): [string, () => void] {
  const [theme, setTheme] = useState(() => localStorage.getItem("swm-theme") ?? "auto");
  useEffect(() => {
    localStorage.setItem("swm-theme", theme);
    document.documentElement.dataset.theme = theme;
    document.dispatchEvent(new Event("swm-theme"));
  }, [theme]);
  return [theme, () => setTheme(THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length])];
}

function App() {
  const [at, setAt] = useState(place);
  const [theme, nextTheme] = useTheme();
  const about = useGet<About>("about");
  useEffect(() => {
    // The token has been used: it only makes the address long.
    if (location.search) history.replaceState(null, "", "/" + location.hash);
    const moved = () => setAt(place());
    addEventListener("hashchange", moved);
    return () => removeEventListener("hashchange", moved);
  }, []);
  useEffect(() => { document.title = `swm · ${at.view}`; }, [at.view]);
  return (
    <>
      <header class="top">
        <a class="brand" href="#play"><img src="/assets/icon.svg" alt="" width="22" height="22" /><b>swm</b></a>
        <nav aria-label="Views">
          {VIEWS.map((view) => (
            <a key={view} href={`#${view}`} aria-current={view === at.view ? "page" : undefined}>{view[0].toUpperCase() + view.slice(1)}</a>
          ))}
        </nav>
        <button type="button" class="quiet" onClick={nextTheme} aria-label={`Colors: ${theme}`} title="Colors">
          {theme === "auto" ? "◐" : theme === "light" ? "○" : "●"}<span> {theme}</span>
        </button>
      </header>
      <main>
        <Notice text={about.error} />
        {about.value && at.view === "play" && <Play about={about.value} query={at.query} />}
        {about.value && at.view === "data" && <Data about={about.value} query={at.query} />}
        {about.value && at.view === "run" && <Run about={about.value} />}
        {about.value && at.view === "results" && <Results query={at.query} />}
      </main>
    </>
  );
}

render(<App />, document.getElementById("app")!);
