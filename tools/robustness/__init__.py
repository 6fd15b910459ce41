"""Odd inputs for every command and function: what no call may do is looked for, case by case."""
