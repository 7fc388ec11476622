"""A user's visit to the page: what they press and see, in the language and on the screen that are tested."""

import re

from playwright.sync_api import expect
from running import choose_option

from simrob_drake.extensions.pendant.pages.words import texts_of, words

SCREENS = {"en": (1366, 768), "es": (1920, 1080)}  # width and height [px]


class Visit:
    """A page in one language: what a user presses and sees there, by the keys of its texts."""

    def __init__(self, page, pendant, language):
        self.page = page
        self.words = words(language)
        self.texts = texts_of(language)
        width, height = SCREENS[language]
        page.set_viewport_size({"width": width, "height": height})
        page.goto(pendant.url)
        self.idle()
        self.choose_pace()

    def choose_pace(self, pace=None):
        """Choose the pace of runs as a multiple of the clock; as fast as they can go unless one is given."""
        option = self.texts["run.fastest"] if pace is None else f"{self.words.figure(pace)} ×"
        choose_option(self.page, self.texts["run.pace"], option, within=".pendant-run")

    def button(self, key):
        return self.page.get_by_role("button", name=self.texts[key], exact=True)

    def press(self, key):
        expect(self.button(key).first).to_be_enabled()
        self.button(key).first.click()

    def press_numbered(self, key):
        """Press a button whose text has the number of its turn before it."""
        name = re.compile(rf"^(\d\. )?{re.escape(self.texts[key])}$")
        button = self.page.get_by_role("button", name=name)
        expect(button).to_be_enabled()
        button.click()

    def test_and_add(self, key, count):
        """Press a button that tests something, and store it once its run has ended as the moves up to a count."""
        clock = self.page.locator(".pendant-time")
        before = clock.inner_text()
        self.press_numbered(key)
        expect(clock).not_to_have_text(before)  # it runs, or has run
        expect(self.page.locator(".pendant-state")).to_have_text(self.texts["phase.idle"])
        self.press_numbered("legs.add")
        expect(self.page.locator(".pendant-block")).to_have_count(count)

    def push(self, side, newtons, seconds):
        """Begin a run, push the robot at its first moment, and let the run go on."""
        expect(self.button("run.play")).to_be_enabled()
        force = self.page.get_by_role("spinbutton", name=self.texts["push.force"], exact=True)
        if not force.is_visible():
            pad = self.page.locator(".pendant-see .q-expansion-item")
            pad.get_by_text(self.texts["push.title"], exact=True).click()
        force.fill(str(newtons))
        self.page.get_by_role("spinbutton", name=self.texts["push.duration"], exact=True).fill(
            str(seconds)
        )
        self.press("run.tick")
        expect(self.page.locator(".pendant-state")).to_have_text(self.texts["phase.paused"])
        self.page.get_by_role("button", name=self.texts["push.along"].format(side=side)).click()
        self.press("run.play")

    def idle(self):
        expect(self.page.locator(".pendant-state")).to_have_text(self.texts["phase.idle"])
        expect(self.button("run.play")).to_be_enabled()

    def lines(self, severity):
        """Lines of the message that have a severity."""
        return self.page.locator(f".pendant-message > .pendant-{severity}")

    def open_legs(self):
        self.page.get_by_role("tab", name=self.texts["shell.legs_tab"]).click()

    def open_station(self):
        self.page.get_by_role("tab", name=self.texts["shell.station_tab"]).click()

    def set_key(self, key, text):
        """Give a key of the station another value, and wait until it is changed."""
        self.page.get_by_label(self.texts["station.search"]).fill(key)
        field = self.page.get_by_role("textbox", name=key, exact=True)
        field.fill(text)
        field.press("Enter")
        expect(
            self.page.locator(".q-chip").get_by_text(re.compile(f"^{re.escape(key)}: "))
        ).to_be_visible()
        self.idle()

    def scrub(self, key, times):
        """Go through the run by a key of the slider of its moments."""
        handle = self.page.get_by_role("slider", name=self.texts["run.scrub"]).locator(
            "[tabindex='0']"
        )
        for _ in range(times):
            handle.press(key)

    def expect_in_sight(self, locator):
        """Wait until an element lies in the window, which the page sees to once the strip above has its new height."""
        inside = """e => {
            const b = e.getBoundingClientRect();
            return b.right <= innerWidth && b.bottom <= innerHeight;
        }"""
        self.page.wait_for_function(inside, arg=locator.element_handle())
