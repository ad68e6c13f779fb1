"""The import is `semcal_cli`: who writes `import semcal` reads so, beside a clone of that name, too."""

raise ImportError(
    "semcal: found the name of the distribution, expected that of its import: import semcal_cli as semcal"
)
