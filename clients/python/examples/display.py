"""Role display: print what the patient does, in asyncio, beside the newest events."""

import asyncio
import sys

from gaitd_client import Activity, AsyncTrainer, NotValid
from gaitd_texts import Reader, catalogue


def line(activity: Activity | NotValid) -> str:
    """Format one item: a number only where it is valid."""
    if isinstance(activity, NotValid):
        return f"no signal: {activity.text}"
    hip = activity.hip
    if hip.patient is None:
        return f"{activity.mode}: patient unknown ({hip.validity})"
    return f"{activity.mode}: patient {hip.patient:+.1f} N·m at the hip"


async def main(trainer: AsyncTrainer, line_count: int) -> None:
    """Print so many lines of activity, and all events meanwhile."""
    texts = catalogue(Reader.OPERATOR, "en")

    async def print_events() -> None:
        async for event in trainer.events(history_count=5):
            print(event.text if isinstance(event, NotValid) else texts.event(event))

    events = asyncio.create_task(print_events())
    async for activity in trainer.activity("right"):
        print(line(activity))
        line_count -= 1
        if not line_count:
            break
    events.cancel()


async def run(endpoint: str, credentials: str | None) -> None:
    """Connect, wait for the service if it is away, and print until the program is ended."""
    async with AsyncTrainer(endpoint, credentials, keep_trying=True) as trainer:
        await main(trainer, line_count=-1)


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], sys.argv[2] if sys.argv[2:] else None))
