# Whether PATTERN finds the rank in what either runner prints, and no rank of another failure.
set(place "[test_runner_mpi_must_fail.pf:11]")
foreach(output IN ITEMS
    "     ${place} found 1, expected equal to 0 (PE=1)\n"
    "Failure\n in:\ntest_fails[npes=2]\n  Location:\n${place}\nAssertEqual failure:\n  Expected: <0>\n  Actual: <1> (PE=1)\n")
  if(NOT output MATCHES "${PATTERN}")
    message(SEND_ERROR "no rank is found in\n${output}")
  endif()
endforeach()
set(output "${place}\nExpected <0> but was <1> (PE=0)\n\n[unknown location]\nInsufficient processes (PE=1)\n")
if(output MATCHES "${PATTERN}")
  message(SEND_ERROR "the rank of another failure is taken in\n${output}")
endif()
