"""What a control script uses: the controller, task files, and a loop to run them in."""
