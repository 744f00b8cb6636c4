"""The command line as types: one dataclass a command, read by tyro."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from typing import Annotated, cast, get_args

import tyro

from etude.commands.abandon import Abandon
from etude.commands.ask import Ask
from etude.commands.bench import Bench
from etude.commands.demo import Demo
from etude.commands.doctor import Doctor
from etude.commands.export import Export
from etude.commands.help_texts import Page, in_words
from etude.commands.init import Init
from etude.commands.inspect import Inspect
from etude.commands.outcome import Command
from etude.commands.plugins import Plugins
from etude.commands.predict import Predict
from etude.commands.promote import Promote
from etude.commands.report import Report
from etude.commands.rollback import Rollback
from etude.commands.simulate import Simulate
from etude.commands.status import Status
from etude.commands.study import Study
from etude.commands.tell import Tell
from etude.commands.untell import Untell
from etude.commands.watch import Watch

DESCRIPTION = (
    "Composes the motions that teach a robot's inverse dynamics in as little robot time as possible. "
    "Étude never commands a robot: it writes trajectory files and reads logs. "
    "etude --version says which one this is."
)

AnyCommand = (
    Annotated[Init, tyro.conf.subcommand("init")]
    | Annotated[Ask, tyro.conf.subcommand("ask")]
    | Annotated[Tell, tyro.conf.subcommand("tell")]
    | Annotated[Inspect, tyro.conf.subcommand("inspect")]
    | Annotated[Untell, tyro.conf.subcommand("untell")]
    | Annotated[Abandon, tyro.conf.subcommand("abandon")]
    | Annotated[Promote, tyro.conf.subcommand("promote")]
    | Annotated[Rollback, tyro.conf.subcommand("rollback")]
    | Annotated[Watch, tyro.conf.subcommand("watch")]
    | Annotated[Status, tyro.conf.subcommand("status")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Predict, tyro.conf.subcommand("predict")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
    | Annotated[Study, tyro.conf.subcommand("study")]
    | Annotated[Plugins, tyro.conf.subcommand("plugins")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)


def command(arguments: Sequence[str]) -> Command:
    """The command that the arguments name. Exits with 2 (wrong usage) or 0 (--help) as tyro does."""
    for own in get_args(AnyCommand):
        in_words(get_args(own)[0])
    page = Page(sys.stdout)
    try:
        with redirect_stdout(page):
            found = tyro.cli(
                AnyCommand,
                prog="etude",
                description=DESCRIPTION,
                args=list(arguments),
                config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.FlagCreatePairsOff),
            )
    finally:
        page.printed()
    return cast(Command, found)
