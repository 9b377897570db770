"""The page as a person sees it: in a real Chromium, without a screen and without a network."""

import shutil
import time
from io import BytesIO

import numpy as np
import pytest
from matplotlib import image
from support.views import TASK

import invariantqp as iq
from invariantqp.workbench.runs.taskfile import task_from
from invariantqp.workbench.view.timeline import arm_in, timeline_of

webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium; it comes with the extra 'test'")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
DRIVER = shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="no Chromium with its chromedriver on the PATH")
# Software WebGL where there is no graphics card.
FLAGS = "--headless=new --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --window-size=1000,700"
# What a picture that is not blank has of different colours, at least.
COLOURFUL = 50


@pytest.fixture(scope="module")
def browser():
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in FLAGS.split():
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    chromium = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield chromium
    chromium.quit()


@pytest.fixture(scope="module")
def trace():
    return iq.run_task(task_from(TASK, "short"))


@pytest.fixture(scope="module")
def page(trace, tmp_path_factory):
    return iq.workbench.animation(trace, tmp_path_factory.mktemp("page") / "short.html")


@pytest.fixture
def opened(browser, page):
    """The page, standing still at half a second."""
    browser.get("about:blank")
    browser.get_log("browser"), browser.get_log("performance")
    browser.get(f"{page.as_uri()}#0.5")
    return browser


def until(condition, patience=60.0):
    """Whether a condition comes true in good time."""
    end = time.monotonic() + patience
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.05)
    return met


def errors(browser):
    return [line for line in browser.get_log("browser") if line["level"] == "SEVERE"]


def pixels(png):
    """(n, 3) of a picture, 0 to 255."""
    return (255 * image.imread(BytesIO(png))[..., :3]).astype(int).reshape(-1, 3)


def colours(png):
    """How many different colours a picture has."""
    return len(np.unique(pixels(png) @ (65536, 256, 1)))


def clock(browser):
    return float(browser.find_element("id", "clock").text.split()[0])


def test_the_page_shows_robot_curves_and_joints(opened, trace):
    timeline = timeline_of(trace)
    assert errors(opened) == []
    assert clock(opened) == 0.5
    for canvas in opened.find_elements("css selector", "canvas"):
        assert colours(canvas.screenshot_as_png) > COLOURFUL
    seen = pixels(opened.find_element("id", "view").screenshot_as_png)
    for drawn in ((230, 159, 0), (0, 114, 178), (47, 98, 214), (204, 121, 167)):  # paths, z axis of the tool, a joint
        assert np.abs(seen - drawn).max(axis=1).min() < 40
    assert len(opened.find_elements("css selector", "canvas")) == 1 + len(timeline.charts)
    rows = [row.text for row in opened.find_elements("css selector", "#joints tr")[1:]]
    assert [row.split()[0] for row in rows] == list(timeline.joints)
    assert rows[1].split()[-2:] == [
        f"{np.degrees(timeline.q[50, 1]):.1f}°",
        f"{np.degrees(timeline.speed[50, 1]):.1f}°/s",
    ]
    header = opened.find_element("css selector", "#joints tr").text
    assert header.split(maxsplit=3)[:3] == ["position,", "in", "its"]
    assert "velocity, of its limit" in header
    assert "error" in opened.find_element("id", "status").text


def test_the_page_places_the_arm_where_it_is(opened, trace):
    timeline = timeline_of(trace)
    seen = opened.execute_script("return arm.at(between('q', 37))")
    np.testing.assert_allclose(seen["points"], timeline.points[37], atol=1e-6)  # the page has float32
    directions = task_from(TASK, "short").load_robot().jacobian(timeline.q[37])[:3].T
    np.testing.assert_allclose(seen["axes"], directions, atol=1e-6)
    np.testing.assert_allclose(np.reshape(seen["tool"], (3, 4)), timeline.tool[37, :3], atol=1e-6)
    motion = task_from(TASK, "short").load_robot().motions(timeline.q[37])[7]
    np.testing.assert_allclose(np.reshape(seen["motions"][7], (3, 4)), motion[:3], atol=1e-6)


def test_the_page_places_an_arm_with_mimic_joints(opened):
    rows = (("a", "l0", ""), ("b", "l1", '<mimic joint="c" multiplier="-0.5"/>'), ("c", "l2", ""))
    text = '<robot name="m"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/>' + "".join(
        f'<joint name="{name}" type="revolute"><parent link="{above}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0.3 0 0.2"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
        f"{mimic}</joint>"
        for i, (name, above, mimic) in enumerate(rows)
    )
    robot, q = iq.load_robot(f"{text}</robot>"), np.array([0.3, -0.7])
    made = arm_in(robot, q[None])
    names = ("screws", "coordinates", "drivers", "places", "home")
    given = [np.asarray(made[name]).ravel().tolist() for name in names]
    seen = opened.execute_script("return new Arm(...arguments[0]).at(arguments[1])", given, q.tolist())
    np.testing.assert_allclose(seen["points"], made["points"][0], atol=1e-12)
    np.testing.assert_allclose(np.reshape(seen["tool"], (3, 4)), robot.pose(q)[:3], atol=1e-12)
    np.testing.assert_allclose(np.reshape(seen["motions"], (-1, 3, 4)), robot.motions(q)[:, :3], atol=1e-12)
    assert len(seen["axes"]) == 2


def test_an_arrow_is_seen_where_the_tool_moves_however_fast_it_was_elsewhere(opened):
    drawn = """const all = [], bar = painter.bar; painter.bar = (a, b) => all.push(norm(add(b, a, -1)) / r);
      arrow([0, 0, 0], [0, 0, arguments[0]], [1e-3, 1], [0, 0, 0], ""); delete painter.bar;
      return all.reduce((a, b) => a + b, 0);"""
    assert [opened.execute_script(drawn, pace) for pace in (9e-4, 2e-3, 0.5)] == pytest.approx([0, 0.035, 0.175])


def test_the_page_asks_nothing_of_a_network(opened):
    asked = [line["message"] for line in opened.get_log("performance") if "requestWillBeSent" in line["message"]]
    assert asked
    assert not [message for message in asked if "http://" in message or "https://" in message]


def set_speed(browser, power):
    """Play at 2^power."""
    slide = "const s = document.getElementById('speed'); s.value = arguments[0]; s.dispatchEvent(new Event('input'))"
    browser.execute_script(slide, power)


def test_play_and_pause_and_the_end(opened):
    button = opened.find_element("id", "play")
    assert button.text == "Play"
    set_speed(opened, -4)
    button.click()
    assert button.text == "Pause"
    assert until(lambda: 0.5 < clock(opened) < 1.0)
    button.click()
    assert button.text == "Play"
    stood = clock(opened)
    time.sleep(0.2)
    assert clock(opened) == stood
    set_speed(opened, 3)
    button.click()
    assert until(lambda: button.text == "Play")
    assert clock(opened) == 1.0
    set_speed(opened, -4)
    button.click()  # from the start again
    assert clock(opened) < 1.0
    assert errors(opened) == []


def test_time_can_be_dragged_and_the_picture_follows(opened):
    view = opened.find_element("id", "view")
    before = view.screenshot_as_png
    slide = "const t = document.getElementById('time'); t.value = 0.9; t.dispatchEvent(new Event('input'))"
    opened.execute_script(slide)
    assert clock(opened) == 0.9
    assert view.screenshot_as_png != before
    set_speed(opened, -2)
    assert opened.find_element("id", "rate").text == "0.25 x"
    chart = opened.find_element("css selector", ".chart")
    webdriver.ActionChains(opened).move_to_element(chart).click().perform()
    assert 0.3 < clock(opened) < 0.7
    turned = view.screenshot_as_png
    webdriver.ActionChains(opened).drag_and_drop_by_offset(view, 80, 30).perform()
    assert view.screenshot_as_png != turned
    assert errors(opened) == []
