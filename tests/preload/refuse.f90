!> A DGEQP3 that finds its eighth argument wrong, as LAPACK does: preloaded by a test of how biela ends then.
module refuse
  use, intrinsic :: iso_c_binding, only: c_int, c_double, c_char, c_size_t
  implicit none (type, external)
  private
  public :: refuse_dgeqp3

  interface
    !> What LAPACK calls where an argument is wrong.
    subroutine xerbla(name, argument, length) bind(c, name='xerbla_')
      import :: c_char, c_int, c_size_t
      integer(c_size_t), value :: length
      character(kind=c_char), intent(in) :: name(length)
      integer(c_int), intent(in) :: argument
    end subroutine xerbla
  end interface

contains

  !> Refuses its work space; the matrix stays as it is.
  subroutine refuse_dgeqp3(m, n, a, lda, pivots, tau, work, lwork, info) bind(c, name='dgeqp3_')
    integer(c_int), intent(in) :: m, n, lda, lwork
    real(c_double), intent(inout) :: a(lda, *), tau(*), work(*)
    integer(c_int), intent(inout) :: pivots(*)
    integer(c_int), intent(out) :: info
    info = -8
    call xerbla(['D', 'G', 'E', 'Q', 'P', '3'], 8_c_int, 6_c_size_t)
  end subroutine refuse_dgeqp3
end module refuse
