!> A setter of a BLAS library's threads that says what it is told: preloaded by a test that biela asks for one thread.
module threads
  use, intrinsic :: iso_c_binding, only: c_int
  implicit none (type, external)
  private
  public :: say_threads

contains

  !> In place of OpenBLAS's own.
  subroutine say_threads(n) bind(c, name='openblas_set_num_threads')
    integer(c_int), value :: n
    write (*, '(a, i0)') 'threads: ', n
  end subroutine say_threads
end module threads
