"""Shell completion, derived from the parser itself: `eval "$(cobot completion bash)"`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

_BASH = """\
_cobot() {{
  local word="${{COMP_WORDS[COMP_CWORD]}}" command="${{COMP_WORDS[1]}}" words
  if [ "$COMP_CWORD" -eq 1 ]; then
    words="{commands}"
  else
    case "$command" in
{cases}
    esac
  fi
  COMPREPLY=($(compgen -W "$words" -- "$word"))
  case "$word" in -*) ;; *) [ "$COMP_CWORD" -gt 1 ] && COMPREPLY+=($(compgen -f -- "$word")) ;; esac
}}
complete -o filenames -F _cobot cobot"""


def completion(shell: str, parser: argparse.ArgumentParser) -> str:
    """The completion script for a shell.

    Args:
        shell: "bash", "zsh" or "fish".
    """
    commands = dict(_commands(parser))
    if shell == "fish":
        return "\n".join(_fish(commands))
    cases = "\n".join(f'      {name}) words="{" ".join(_words(each))}" ;;' for name, each in commands.items())
    text = _BASH.format(commands=" ".join(commands), cases=cases)
    return text if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{text}"


def _fish(commands: dict[str, argparse.ArgumentParser]) -> Iterator[str]:
    for name, each in commands.items():
        yield f"complete -c cobot -n __fish_use_subcommand -f -a {name}"
        for word in _words(each):
            only = f'-n "__fish_seen_subcommand_from {name}"'
            yield f"complete -c cobot {only} " + (f"-l {word[2:]}" if word.startswith("--") else f"-a {word}")


def _commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.items()


def _words(parser: argparse.ArgumentParser) -> list[str]:
    """The long options, choice values and subcommands of this parser."""
    words: list[str] = []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction) or (action.choices and not action.option_strings):
            words += map(str, action.choices or ())
        words += [option for option in action.option_strings if option.startswith("--")]
    return words
