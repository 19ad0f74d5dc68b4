"""The verbs of the command line, one a file; `pipeline/cli.py` puts them together. A verb parses and prints, the engine
does."""
