"""The maintenance task: tools up to a person on a ladder, tools back, put down."""
