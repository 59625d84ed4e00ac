"""What the tests of the playbook page do again and again, as a person would."""

from collections.abc import Callable
from typing import Any

from protocols.deployment.operator.page import PAGE as PLAYBOOK

PAGE = PLAYBOOK.html


def ready(page: Any) -> None:
    """Wait until the page knows plays and team."""
    page.wait_for_selector("#plays li")
    page.wait_for_selector("#team button >> nth=2")


def choose(page: Any, path: str) -> None:
    """Choose a play in the tree, opening what it is in."""
    page.wait_for_selector("#plays li")
    for at in range(1, path.count("/") + 1):
        above = page.locator(f"#plays .row[data-id='{'/'.join(path.split('/')[:at])}']")
        if above.get_attribute("aria-expanded") == "false":
            above.locator("> .twist").click()
    page.locator(f"#plays li[data-id='{path}'] > .row").click()


def add_place(page: Any, text: str) -> None:
    page.fill("#form .places input", text)
    page.press("#form .places input", "Enter")


def focused(page: Any) -> str:
    identity: str = page.evaluate("document.activeElement.dataset.id || document.activeElement.id")
    return identity


SHOWN = """async () => {
  const drawn = new Promise((resolve) => requestAnimationFrame(() => resolve(true)));
  const waited = new Promise((resolve) => setTimeout(() => resolve(false), 2000));
  const draws = await Promise.race([drawn, waited]);
  return { draws, visible: document.visibilityState, text: document.body.innerText };
}"""
"""What a page shows, and whether the browser has it draw pictures."""


def until(page: Any, condition: str, seconds: float = 90) -> None:
    """Wait until a condition, in the words of the browser, holds; say what the page shows if it does not."""
    from playwright.sync_api import TimeoutError as LateError  # who has a page has that

    try:
        page.wait_for_function(f"() => {condition}", timeout=1000 * seconds)
    except LateError as error:
        raise AssertionError(f"{condition} does not hold after {seconds} s: {page.evaluate(SHOWN)}") from error


def settled(page: Any, count: Callable[[], int], wanted: int, seconds: float = 10) -> None:
    """Wait until what a page has sent has come, *wanted* of it, and a little longer, in which no more is to come."""
    for _ in range(round(20 * seconds)):
        if count() >= wanted:
            break
        page.wait_for_timeout(50)
    page.wait_for_timeout(100)


def tailoring(page: Any) -> None:
    choose(page, "deploy/group")
    page.select_option("#form .places select", label="posts, all 2")
    page.click("#tailor")
    page.wait_for_selector("#draft li")


def playing(page: Any) -> None:
    choose(page, "deploy/group")
    page.click("#execute")
    page.wait_for_selector("#tasks li")
