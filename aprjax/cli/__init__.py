"""The command `aprjax`, a module for each subcommand."""
