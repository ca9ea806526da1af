"""What a run costs against the length of a video and against the number of its key frames."""
