"""`invariantqp drag` in a real browser: the target is dragged by the mouse, and statuses, numbers and console are read.

    PYTHONPATH=tests python -m support.drag_in_browser [--pictures FOLDER] [--film FILE.gif]

It fails where Chromium or its chromedriver is missing. `--pictures` also writes screenshots of five situations, with
ghosts, at 1280 and at 390 pixels, light and dark.
"""

import argparse
import gc
import shutil
import time
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation
from selenium import webdriver

import invariantqp as iq
from invariantqp.workbench.compare.sweep import methods_named
from invariantqp.workbench.drag.page import DragPage
from invariantqp.workbench.drag.session import HISTORY, RATE, Session, Settings

FLAGS = "--headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader"
# Lines of the console that are viser's and harmless, or of the missing graphics card.
HARMLESS = ("THREE.", "WebGL", "GPU", "favicon", "Connecting", "Connected", "swiftshader", "GL Driver")


def browser(width, height=850):
    """A Chromium with a window of a size [pixels]; below 600 wide, a phone."""
    driver, chromium = shutil.which("chromedriver"), shutil.which("chromium") or shutil.which("google-chrome")
    if not (driver and chromium):
        raise SystemExit("no Chromium with its chromedriver on the PATH")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS.split(), f"--window-size={max(width, 500)},{height}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    chrome = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600}
    chrome.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    return chrome


def until(condition, what, patience=60.0):
    """Wait for a condition."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, f"not within {patience:g} s: {what}"
        time.sleep(0.1)


def text(chrome, name):
    """The text of an element; "" without one."""
    return chrome.execute_script(f"return document.getElementById('{name}')?.innerText ?? ''")


def opened(page, width, height=850):
    """A browser with the page, connected and drawn."""
    before, chrome = page.clients, browser(width, height)
    chrome.get(page.url)
    until(lambda: page.clients == before + 1, "a connection")
    until(lambda: text(chrome, "status"), "a status")
    time.sleep(3.0)  # meshes
    return chrome


def pixel(page, chrome, point):
    """Where a point (3,) of the scene is in the browser's picture."""
    camera = list(page._server.get_clients().values())[-1].camera
    w, x, y, z = camera.wxyz
    right, down, ahead = Rotation.from_quat([x, y, z, w]).inv().apply(np.asarray(point) - camera.position)
    canvas = chrome.find_element("css selector", "canvas").rect
    scale = 0.5 * canvas["height"] / np.tan(0.5 * camera.fov) / ahead
    return np.array(
        [canvas["x"] + 0.5 * canvas["width"] + scale * right, canvas["y"] + 0.5 * canvas["height"] + scale * down]
    )


def drag(page, chrome, axis, pixels):
    """Drag the target along one of its axes by the mouse."""
    target = page.session.target
    here = pixel(page, chrome, target[:3, 3])
    tip = pixel(page, chrome, target[:3, 3] + 0.2 * page.session.reach * target[:3, axis])
    along = (tip - here) / np.linalg.norm(tip - here)
    grip = here + 0.85 * (tip - here)
    mouse = webdriver.ActionChains(chrome, duration=50)
    mouse.w3c_actions.pointer_action.move_to_location(*map(int, grip))
    mouse.w3c_actions.pointer_action.pause(0.3)
    mouse.w3c_actions.pointer_action.pointer_down()
    for k in range(1, 11):
        mouse.w3c_actions.pointer_action.move_to_location(*map(int, grip + 0.1 * k * pixels * along))
    mouse.w3c_actions.pointer_action.pointer_up()
    mouse.perform()


def errors(chrome):
    """Lines of the console that are errors or warnings of the page."""
    lines = [line for line in chrome.get_log("browser") if line["level"] in ("SEVERE", "WARNING")]
    return [line["message"] for line in lines if not any(word in line["message"] for word in HARMLESS)]


def is_at_rest(session):
    return np.abs(session.ours.velocity).max() < 1e-3


def check():
    """The mouse drags the target, the arm follows; tabs that close, and a slow one, change nothing."""
    page = DragPage(Session(iq.load_robot("panda"), "panda", methods_named(["Moore-Penrose"])), port=0)
    session = page.session
    try:
        chrome = opened(page, 1280)
        assert page._server.get_host() == "127.0.0.1"
        moved = []
        for axis in range(3):
            before = session.target[:3, 3].copy()
            drag(page, chrome, axis, 60.0)
            time.sleep(0.5)
            moved.append(float(np.linalg.norm(session.target[:3, 3] - before)))
        print("the target was dragged by", np.round(moved, 3), "m")
        assert max(moved) > 0.01
        tool = session.robot.pose
        until(
            lambda: np.linalg.norm(tool(session.ours.q)[:3, 3] - session.target[:3, 3]) < 1e-3, "the arm at the target"
        )
        until(lambda: text(chrome, "status") in ("moving", "ok"), "a status at the target")
        session.target = session.target.copy()
        session.target[0, 3] += 3.0
        until(lambda: text(chrome, "status") in ("late", "left", "limited"), "a status out of reach")
        assert text(chrome, "reason")
        until(lambda: is_at_rest(session), "rest out of reach")
        other = opened(page, 390, 844)
        assert page.clients == 2
        assert text(other, "status") == text(chrome, "status")
        other.quit()
        until(lambda: page.clients == 1, "a tab that closed")
        # A tab that does not run: what it is not sent does not pile up.
        chrome.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
        ticks = session.ticks
        time.sleep(HISTORY + 2.0)
        assert session.ticks - ticks > 0.5 * (HISTORY + 2.0) / 0.002
        assert len(session.ours.history) == round(HISTORY * RATE)
        gc.collect()
        chrome.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
        found = errors(chrome)
        assert not found, found
        chrome.quit()
    finally:
        page.close()
    print("the page follows the mouse, its statuses are those of the library, and its console is empty")


# Name, arm, settings, and how the target goes from its start [m], [rad about its y axis].
SITUATIONS = (
    ("limit", "panda", Settings(), (0.0, 0.45, -0.1), 0.0),
    ("singularity", "ur5", Settings(ghost_limit=False), (-1.0, 0.0, 0.3), 0.0),
    ("out_of_reach", "panda", Settings(ghost_limit=False), (0.6, 0.3, 0.2), 0.0),
    ("five_joints", "so101", Settings(exact=True), (0.02, 0.1, 0.03), 0.5),
    ("displaced_tool_frame", "so101", Settings(displaced=True), (0.02, 0.1, 0.03), 0.0),
)


def pictures(folder):
    """Screenshots of the situations."""
    for i, (name, arm, settings, move, turn) in enumerate(SITUATIONS):
        methods = methods_named(["Moore-Penrose", "DLS"])
        page = DragPage(Session(iq.load_robot(arm), arm, methods), port=0, dark=i % 2 == 1)
        session = page.session
        page._exact.value, page._displaced.value = settings.exact, settings.displaced
        page._ghost_limit.value = settings.ghost_limit
        page._request()
        try:
            for width, height in ((1280, 850), (390, 844)):
                chrome = opened(page, width, height)
                start = session.robot.pose(session.start)
                for k in range(61):
                    share = k / 60.0
                    target = start @ iq.exp([0.0, share * turn, 0.0, 0.0, 0.0, 0.0])
                    target[:3, 3] = start[:3, 3] + share * np.array(move)
                    session.target = target
                    page._place_target()
                    time.sleep(0.03)
                time.sleep(1.5)
                chrome.save_screenshot(str(folder / f"{name}_{width}.png"))
                print(
                    name,
                    width,
                    text(chrome, "status"),
                    text(chrome, "reason"),
                    [(a.name, np.round(a.worst(), 2)) for a in session.arms],
                )
                chrome.quit()
                page._reset.set()
                time.sleep(0.5)
        finally:
            page.close()


def film(file, seconds=5.0, rate=5.0):
    """The five joints of SITUATIONS go and come back, with ghosts, a frame every 1 / rate [s] of their time."""
    _, arm, settings, move, turn = SITUATIONS[3]
    page = DragPage(Session(iq.load_robot(arm), arm, methods_named(["Moore-Penrose", "DLS"])), port=0)
    session, frames = page.session, []
    page._exact.value = settings.exact
    page._request()
    page._closed.set()
    page._thread.join()  # from here on this function runs the loop
    session.advance(0.02)
    page._write()
    chrome = opened(page, 960, 540)
    for close in chrome.find_elements("css selector", ".mantine-Notification-closeButton"):
        close.click()
    start = session.robot.pose(session.start)
    for _ in range(round(seconds * rate)):
        for _ in range(round(1.0 / (rate * 0.02))):
            share = np.sin(np.pi * session.time / seconds) ** 2
            target = start @ iq.exp([0.0, share * turn, 0.0, 0.0, 0.0, 0.0])
            target[:3, 3] = start[:3, 3] + share * np.array(move)
            session.target = target
            session.advance(0.02)
        page._place_target()
        page._draw()
        page._write()
        page._server.flush()
        time.sleep(0.4)
        picture = Image.open(BytesIO(chrome.get_screenshot_as_png())).convert("RGB").crop((140, 20, 960, 540))
        frames.append(picture.resize((631, 400)).quantize(64))
    chrome.quit()
    page._server.stop()
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=round(1e3 / rate), loop=0, optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--film", type=Path)
    asked = parser.parse_args()
    check()
    if asked.pictures:
        asked.pictures.mkdir(parents=True, exist_ok=True)
        pictures(asked.pictures)
    if asked.film:
        film(asked.film)
