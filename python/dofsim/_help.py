"""The help of the commands: plain text of at most 80 columns, whatever the version of Typer."""

from __future__ import annotations

from typing import Any

from typer.core import TyperCommand, TyperGroup

__all__ = ["Command", "Group", "sections", "usage"]

# Wider names of options stand on a line of their own.
_FIRST_COLUMN = 26

Row = tuple[str, str]


class Command(TyperCommand):
    """A command whose options are listed by their subjects."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of the command.

        Parameters
        ----------
        ctx : Context
            That of the command.
        formatter : HelpFormatter
            Where it is written.
        """
        _write(self, ctx, formatter)


class Group(TyperGroup):
    """The command that has all others."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of the group.

        Parameters
        ----------
        ctx : Context
            That of the group.
        formatter : HelpFormatter
            Where it is written.
        """
        _write(self, ctx, formatter)
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        rows = [(name, _unwrapped(one.help or "").split("\n\n")[0]) for name, one in commands if one]
        with formatter.section("Commands"):
            formatter.write_dl(rows, col_max=_FIRST_COLUMN)


def usage(command: Any, ctx: Any) -> str:
    """Give what follows the name of a command.

    Parameters
    ----------
    command : Command
        The command.
    ctx : Context
        Its context.

    Returns
    -------
    str
        Such as ``"IMAGE [DEPTH] [OPTIONS]"``.
    """
    parameters = command.get_params(ctx)
    arguments = [one for one in parameters if one.param_type_name == "argument"]
    words = [_argument_name(one) if one.required else f"[{_argument_name(one)}]" for one in arguments]
    for parameter in parameters:
        if parameter.required and parameter not in arguments:
            words.append(f"{min(parameter.opts, key=len)} {parameter.metavar}")
    words.append("[OPTIONS]" if not isinstance(command, Group) else "COMMAND [OPTIONS]")
    return " ".join(words)


def sections(command: Any, ctx: Any) -> dict[str, list[Row]]:
    """Give the arguments and the options of a command, by their subjects.

    Parameters
    ----------
    command : Command
        The command.
    ctx : Context
        Its context.

    Returns
    -------
    dict of str to list of tuple of str
        Each how it is written, and what it means.
    """
    found: dict[str, list[Row]] = {"Arguments": [], "Options": []}
    for parameter in command.get_params(ctx):
        if getattr(parameter, "hidden", False):
            continue
        if parameter.param_type_name == "argument":
            found["Arguments"].append((_argument_name(parameter), parameter.help or ""))
        else:
            subject = getattr(parameter, "rich_help_panel", None) or "Options"
            found.setdefault(subject, []).append((_option_name(parameter), _meaning(parameter)))
    # What all commands have stands last.
    found["Options"] = found.pop("Options")
    return {subject: rows for subject, rows in found.items() if rows}


def _write(command: Any, ctx: Any, formatter: Any) -> None:
    formatter.write_usage(ctx.command_path, usage(command, ctx))
    if command.help:
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(_unwrapped(command.help))
    for subject, rows in sections(command, ctx).items():
        with formatter.section(subject):
            formatter.write_dl(rows, col_max=_FIRST_COLUMN)


def _unwrapped(text: str) -> str:
    """Join the lines of each paragraph, so that they can be broken anew."""
    paragraphs = (" ".join(paragraph.split()) for paragraph in text.strip().split("\n\n"))
    return "\n\n".join(paragraph for paragraph in paragraphs if paragraph)


def _argument_name(parameter: Any) -> str:
    return str(parameter.metavar or parameter.name.upper())


def _option_name(parameter: Any) -> str:
    names = ", ".join(sorted(parameter.opts, key=len)) if parameter.opts else ""
    if parameter.secondary_opts:
        names += " / " + ", ".join(parameter.secondary_opts)
    if parameter.is_flag:
        return names
    return f"{names} {parameter.metavar}"


def _meaning(parameter: Any) -> str:
    text = str(parameter.help or "")
    default = parameter.default
    if parameter.required:
        return f"{text} Required."
    if parameter.is_flag or default in (None, "") or callable(default) or "default)" in text:
        return text
    return f"{text} [default: {default}]"
