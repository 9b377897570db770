error: output could not be written: No space left on device
