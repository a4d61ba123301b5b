"""The directive ``commands``: every command with all of its options, from the commands themselves."""

import re
from typing import Any

import typer
from docutils import nodes
from docutils.parsers.rst import Directive
from dofsim import _help, cli


class Commands(Directive):
    """A section for each command, with tables of what it takes."""

    def run(self) -> list[nodes.Node]:
        """Make the sections.

        Returns
        -------
        list of Node
            One for each command.
        """
        group: Any = typer.main.get_command(cli.app)
        return [_section(name, group.commands[name]) for name in group.list_commands(None)]


def _section(name: str, command: Any) -> nodes.section:
    context = command.context_class(command, info_name=f"dofsim {name}")
    section = nodes.section(ids=[f"command-{name}"])
    section += nodes.title(text=f"dofsim {name}")
    for paragraph in command.help.split("\n\n"):
        section += _paragraph(" ".join(paragraph.split()))
    section += nodes.literal_block(text=f"dofsim {name} {_help.usage(command, context)}", language="text")
    for subject, rows in _help.sections(command, context).items():
        section += nodes.rubric(text=subject)
        items = nodes.definition_list()
        for option, meaning in rows:
            identity = f"{name}-{option.split()[-2 if ' ' in option else 0].strip(',')}"
            term = nodes.term("", "", nodes.literal(text=option), ids=[nodes.make_id(identity)])
            definition = nodes.definition("", _paragraph(meaning))
            items += nodes.definition_list_item("", term, definition)
        section += items
    return section


def _paragraph(text: str) -> nodes.paragraph:
    """Set options, and what stands between backticks, as they are typed."""
    paragraph = nodes.paragraph()
    for index, part in enumerate(re.split(r"(--[a-z][\w-]*|`[^`]+`)", text)):
        paragraph += nodes.literal(text=part.strip("`")) if index % 2 else nodes.Text(part)
    return paragraph


def setup(app: Any) -> dict[str, Any]:
    """Add the directive to Sphinx.

    Parameters
    ----------
    app : Sphinx
        The application.

    Returns
    -------
    dict
        That it may be used in parallel.
    """
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
