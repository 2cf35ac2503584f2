"""Makes closed_loop.gif of README.md: the IRB 140 under PD control with gravity compensation, as `rne.view` shows it.

It needs Chromium, playwright and the extra `view`. Each frame is placed in the paused page, so that none is lost.
"""

import io
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright
from scipy.spatial.transform import Rotation

import rne
from rne.basics.marks import COMMENT

DURATION, FPS = 3.0, 16  # [s]: the joints are within 0.01 rad of the target by then; frames per second
SIZE = {"width": 560, "height": 470}  # [px] of the window, whose lower part is the player
VIEW = {"x": 0, "y": 0, "width": 560, "height": 420}  # [px] of the picture
COLORS = 96  # of the picture
GRAPHICS = ("--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
HIDDEN = "#rne{display:none}"  # the legend
PLACE = """places => places.forEach(([name, wxyz, position]) => {
    window.__viserMutable.messageQueue.push({type: 'SetOrientationMessage', name, wxyz});
    window.__viserMutable.messageQueue.push({type: 'SetPositionMessage', name, position});
})"""
TRIES = 8  # screenshots of a frame, until one is new and the next one is the same


def screenshot(tab: Page, before: bytes) -> bytes:
    """The view when it has changed, if it does, and rests."""
    last = before
    for _ in range(TRIES):
        tab.wait_for_timeout(80)
        shot = tab.screenshot(clip=VIEW)
        if shot == last != before:
            break
        last = shot
    return last


def frames(robot: rne.Robot, motion: rne.Trajectory, times: np.ndarray) -> list[Image.Image]:
    """Screenshots of the motion's page at the times."""
    poses, shots = robot.link_poses(motion(times)[0]), []
    turned = Rotation.from_matrix(poses[..., :3, :3]).as_quat(scalar_first=True)
    groups = ("robot", "joint axes")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page = rne.view(motion, Path(folder) / "motion.html").path
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=list(GRAPHICS))
        tab = browser.new_page(viewport=SIZE)
        tab.set_default_timeout(100_000)
        tab.goto(page.as_uri())
        tab.wait_for_selector(".mantine-Slider-track")
        tab.keyboard.press("Space")  # pause
        tab.add_style_tag(content=HIDDEN)
        tab.wait_for_timeout(3000)
        for k in range(len(times)):
            places = [
                [f"/{group}/{link}", turned[k, i].tolist(), poses[k, i, :3, 3].tolist()]
                for group in groups
                for i, link in enumerate(robot.link_names)
            ]
            tab.evaluate(PLACE, places)
            shots.append(screenshot(tab, shots[-1] if shots else b""))
        browser.close()
    return [Image.open(io.BytesIO(shot)).convert("RGB") for shot in shots]


def main() -> None:
    target = np.array([1, 0.5, -1, 2, 1, -2])  # [rad]
    robot = rne.load("irb140")
    law = rne.control.pd_gravity(robot, [50] * 5 + [60], [20] * 5 + [22], target)
    motion = rne.simulate(rne.Scene(robot, controller=law), np.zeros(6), np.zeros(6), DURATION)
    assert abs(motion.q[-1] - target).max() < 0.011
    assert motion.check_limits() == []
    pictures = frames(robot, motion, np.linspace(0, DURATION, round(DURATION * FPS) + 1))
    palette = pictures[len(pictures) // 2].quantize(COLORS)
    shown = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_suffix(".gif")
    pause = [round(100 / FPS) * 10] * (len(shown) - 1) + [1500]  # [ms]
    shown[0].save(path, save_all=True, append_images=shown[1:], duration=pause, loop=0, comment=COMMENT)


if __name__ == "__main__":
    main()
