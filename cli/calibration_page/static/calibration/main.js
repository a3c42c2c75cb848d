// The page: what to do next, the two pictures, and below them points, pose and what is saved.
import { startTheme, ThemeButton } from "../page/theme.js";
import { html, render, useEffect } from "../page/ui.js";
import { model, useModel } from "./model.js";
import { Points, Pose, Save } from "./panels.js";
import { getState, keep } from "./server.js";
import { Stages } from "./stages.js";

function nextStep({ points, half, solution, problem, contradicting }) {
  if (half?.px) return "Now click the same place on the plan.";
  if (half?.plan_px) return "Now click the same place in the picture.";
  if (!points.length) return "Click a point in the picture that is on the plan, too: the foot of a corner, doorpost or pillar.";
  if (points.length < 4) return `${points.length} of at least 4 points, better 6 to 10. Click the next one, far from the others.`;
  if (contradicting.size) {
    const numbers = [...contradicting].map(i => i + 1).join(", ");
    return `Check point ${numbers}: is it the same place in the picture and on the plan, and is its height right?`;
  }
  if (problem) return "See below why there is no pose yet.";
  if (!solution) return "Computing …";
  if (points.length < 6) return "There is a pose. Add points, up to 6 or 10: with so few, nothing can tell a wrong click from a right one.";
  return "Look at the picture: do the pink lines follow the feet of the walls? Then save.";
}

function keys(e) {
  if (e.target.matches?.("input[type=number]")) return;
  const undo = (e.ctrlKey || e.metaKey) && !e.shiftKey && e.key.toLowerCase() === "z";
  if (undo) model.undo();
  else if (e.key === "Delete" || e.key === "Backspace") model.remove(model.half ? model.points.length : model.selected);
  else if (e.key === "Escape") model.half ? model.remove(model.points.length) : model.select(-1);
  else return;
  e.preventDefault();
}

function Page() {
  const { state, fault } = useModel();
  useEffect(() => {
    document.title = `Calibrate ${state.camera} – SurveilNav`;
    addEventListener("keydown", keys);
    addEventListener("pagehide", () => { if (model.solving) keep(model.pairs); });
  }, []);
  return html`<header class="bar">
      <h1><img src=${new URL("../icon.svg", import.meta.url)} alt="" width="24" height="24" />Calibrate ${state.camera}</h1>
      <span class="soft">${state.label && `${state.label}, `}floor ${state.floor}</span>
      <p id="next" role="status">${nextStep(model)}</p>
      <${ThemeButton} /></header>
    ${fault && html`<p class="strip bad" role="alert">${fault}</p>`}
    <main><${Stages} /><div class="below"><${Points} /><${Pose} /><${Save} /></div></main>`;
}

startTheme();
const page = document.getElementById("page");
try {
  model.begin(await getState());
  page.replaceChildren();
  render(html`<${Page} />`, page);
} catch (error) {
  page.firstChild.textContent = error.message;
}
