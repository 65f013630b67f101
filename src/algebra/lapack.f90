!> Explicit interfaces to the few LAPACK and BLAS routines used. Band storage: lower, ab(1+i-j, j) = A(i, j).
!> - Threads of these libraries would change results: they get one.
!> - Where an argument is wrong these libraries end the program with status 0. Here the routine is noted, and each analysis asks
!>   for it at its end (`refused_routine`).
module lapack
  use kinds, only: wp
  use text, only: to_text
  use, intrinsic :: iso_c_binding, only: c_ptr, c_funptr, c_char, c_int, c_size_t, c_null_ptr, c_null_char, c_associated, &
                                         c_f_procpointer
  implicit none (type, external)
  private
  public :: dpbtrf, dsyev, dsteqr, dsygvd, dgesv, dgebal, dgeev, dgtsv
  public :: zgbtrf, zgbtrs, dgesdd, dgeqp3, dorgqr
  public :: use_one_blas_thread, refused_routine

  character(32) :: refused = ''                !! the first routine with a wrong argument since `refused_routine` was called

  interface
    !> Cholesky factor of a symmetric positive definite band matrix.
    subroutine dpbtrf(uplo, n, kd, ab, ldab, info)
      import :: wp
      character, intent(in) :: uplo
      integer, intent(in) :: n, kd, ldab
      real(wp), intent(inout) :: ab(ldab, *)   !! matrix, then its factor [any]
      integer, intent(out) :: info
    end subroutine dpbtrf
    !> Eigenvalues and vectors of a symmetric matrix.
    subroutine dsyev(jobz, uplo, n, a, lda, w, work, lwork, info)
      import :: wp
      character, intent(in) :: jobz, uplo
      integer, intent(in) :: n, lda, lwork
      real(wp), intent(inout) :: a(lda, *)   !! matrix, then its eigenvectors [any]
      real(wp), intent(out) :: w(*), work(*) !! eigenvalues, work space [any]
      integer, intent(out) :: info
    end subroutine dsyev
    !> Eigenvalues and vectors of a symmetric tridiagonal matrix.
    subroutine dsteqr(compz, n, d, e, z, ldz, work, info)
      import :: wp
      character, intent(in) :: compz
      integer, intent(in) :: n, ldz
      real(wp), intent(inout) :: d(*), e(*)   !! diagonal, then the eigenvalues; next to it, destroyed [any]
      real(wp), intent(inout) :: z(ldz, *)    !! the eigenvectors [-]
      real(wp), intent(out) :: work(*)        !! work space [any]
      integer, intent(out) :: info
    end subroutine dsteqr
    !> A x = w B x, A symmetric, B symmetric positive definite, all eigenpairs.
    subroutine dsygvd(itype, jobz, uplo, n, a, lda, b, ldb, w, work, lwork, iwork, liwork, info)
      import :: wp
      integer, intent(in) :: itype, n, lda, ldb, lwork, liwork
      character, intent(in) :: jobz, uplo
      real(wp), intent(inout) :: a(lda, *), b(ldb, *)   !! matrices; A, then the eigenvectors [any]
      real(wp), intent(out) :: w(*), work(*)            !! eigenvalues, work space [any]
      integer, intent(out) :: iwork(*), info
    end subroutine dsygvd
    !> Scales rows and columns of a matrix to like sizes.
    subroutine dgebal(job, n, a, lda, ilo, ihi, scale, info)
      import :: wp
      character, intent(in) :: job
      integer, intent(in) :: n, lda
      real(wp), intent(inout) :: a(lda, *)   !! matrix, then scaled [any]
      integer, intent(out) :: ilo, ihi, info
      real(wp), intent(out) :: scale(*)      !! of columns [-]
    end subroutine dgebal
    !> Eigenvalues and vectors of a general real matrix.
    subroutine dgeev(jobvl, jobvr, n, a, lda, wr, wi, vl, ldvl, vr, ldvr, work, lwork, info)
      import :: wp
      character, intent(in) :: jobvl, jobvr
      integer, intent(in) :: n, lda, ldvl, ldvr, lwork
      real(wp), intent(inout) :: a(lda, *)   !! matrix, overwritten [any]
      real(wp), intent(out) :: wr(*), wi(*), vl(ldvl, *), vr(ldvr, *), work(*)   !! eigenvalues, vectors, work space [any]
      integer, intent(out) :: info
    end subroutine dgeev
    !> Solves a general dense system.
    subroutine dgesv(n, nrhs, a, lda, ipiv, b, ldb, info)
      import :: wp
      integer, intent(in) :: n, nrhs, lda, ldb
      real(wp), intent(inout) :: a(lda, *), b(ldb, *)   !! matrix, right-hand sides, then solutions [any]
      integer, intent(out) :: ipiv(*), info
    end subroutine dgesv
    !> Solves with a tridiagonal matrix.
    subroutine dgtsv(n, nrhs, dl, d, du, b, ldb, info)
      import :: wp
      integer, intent(in) :: n, nrhs, ldb
      real(wp), intent(inout) :: dl(*), d(*), du(*), b(ldb, *)   !! three diagonals; right-hand sides, then solutions [any]
      integer, intent(out) :: info
    end subroutine dgtsv
    !> LU factor of a complex band matrix.
    subroutine zgbtrf(m, n, kl, ku, ab, ldab, ipiv, info)
      import :: wp
      integer, intent(in) :: m, n, kl, ku, ldab
      complex(wp), intent(inout) :: ab(ldab, *)   !! matrix, then its factor [any]
      integer, intent(out) :: ipiv(*), info
    end subroutine zgbtrf
    !> Solves with the factor of zgbtrf.
    subroutine zgbtrs(trans, n, kl, ku, nrhs, ab, ldab, ipiv, b, ldb, info)
      import :: wp
      character, intent(in) :: trans
      integer, intent(in) :: n, kl, ku, nrhs, ldab, ldb, ipiv(*)
      complex(wp), intent(in) :: ab(ldab, *)   !! factor [any]
      complex(wp), intent(inout) :: b(ldb, *)  !! right-hand sides, then solutions [any]
      integer, intent(out) :: info
    end subroutine zgbtrs
    !> Singular value decomposition.
    subroutine dgesdd(jobz, m, n, a, lda, s, u, ldu, vt, ldvt, work, lwork, iwork, info)
      import :: wp
      character, intent(in) :: jobz
      integer, intent(in) :: m, n, lda, ldu, ldvt, lwork
      real(wp), intent(inout) :: a(lda, *)   !! matrix, overwritten [any]
      real(wp), intent(out) :: s(*), u(ldu, *), vt(ldvt, *), work(*)   !! singular values and vectors, work space [any]
      integer, intent(out) :: iwork(*), info
    end subroutine dgesdd
    !> QR with column pivoting.
    subroutine dgeqp3(m, n, a, lda, jpvt, tau, work, lwork, info)
      import :: wp
      integer, intent(in) :: m, n, lda, lwork
      real(wp), intent(inout) :: a(lda, *)   !! matrix, then its factors [any]
      integer, intent(inout) :: jpvt(*)
      real(wp), intent(out) :: tau(*), work(*)   !! reflectors, work space [any]
      integer, intent(out) :: info
    end subroutine dgeqp3
    !> Q of a QR factorisation.
    subroutine dorgqr(m, n, k, a, lda, tau, work, lwork, info)
      import :: wp
      integer, intent(in) :: m, n, k, lda, lwork
      real(wp), intent(inout) :: a(lda, *)   !! factors of dgeqp3, then Q [any]
      real(wp), intent(in) :: tau(*)         !! reflectors [any]
      real(wp), intent(out) :: work(*)       !! work space [any]
      integer, intent(out) :: info
    end subroutine dorgqr
    !> The C library's look-up of a symbol among the libraries already loaded.
    function dlsym(handle, symbol) bind(c, name='dlsym') result(address)
      import :: c_ptr, c_funptr, c_char
      type(c_ptr), value :: handle
      character(kind=c_char), intent(in) :: symbol(*)
      type(c_funptr) :: address
    end function dlsym
  end interface

  abstract interface
    !> A BLAS library's own routine that sets its number of threads.
    subroutine set_threads(n) bind(c)
      import :: c_int
      integer(c_int), value :: n
    end subroutine set_threads
  end interface

contains

  !> Threaded BLAS libraries sum in an order that depends on the number of threads; one thread makes runs repeatable.
  subroutine use_one_blas_thread()
    character(28), parameter :: names(4) = [character(28) :: 'openblas_set_num_threads', 'MKL_Set_Num_Threads', &
                                            'bli_thread_set_num_threads', 'flexiblas_set_num_threads']
    procedure(set_threads), pointer :: set
    type(c_funptr) :: address
    integer :: k
    do k = 1, size(names)
      address = dlsym(c_null_ptr, trim(names(k))//c_null_char)
      if (.not. c_associated(address)) cycle
      call c_f_procpointer(address, set)
      call set(1_c_int)
    end do
  end subroutine use_one_blas_thread

  !> What LAPACK and BLAS call where an argument is wrong; they return from the routine afterwards.
  subroutine note_refusal(name, argument, length) bind(c, name='xerbla_')
    integer(c_size_t), value :: length           !! of the name
    character(kind=c_char), intent(in) :: name(length)
    integer(c_int), intent(in) :: argument       !! its number
    integer :: k
    if (len_trim(refused) > 0) return
    do k = 1, min(int(length), 16)
      refused(k:k) = name(k)
    end do
    refused = trim(refused)//', argument '//to_text(int(argument))
  end subroutine note_refusal

  !> The first routine that has refused its arguments since this was last asked, and which argument; empty: none.
  function refused_routine() result(text)
    character(:), allocatable :: text
    text = trim(refused)
    refused = ''
  end function refused_routine
end module lapack
