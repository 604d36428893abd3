"""The command line: one small file for each subcommand, loaded when it is called."""
