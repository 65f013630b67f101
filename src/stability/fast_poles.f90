!> Eigenvalues of the damped mechanism on the space of its fastest motions: the fastest modes of the instantaneous stiffness, and
!> the motions that dampers oppose most. Damping and viscoelastic terms couple these motions; the eigenvalues of one motion alone
!> are not those of the mechanism.
module fast_poles
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use linear_matrices, only: number_laws
  use mass_solve, only: solve_mass
  use mechanism, only: mechanism_model
  use reduced_system, only: reduced_model, reduced_poles, usual_unknowns
  use spring_products, only: argument_motions, argument_pull
  use spectrum, only: fast_spectrum, fast_mode, no_part, only_damping, only_stiffness
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: pole_list, find_fast_poles

  integer, parameter :: widest = 24                !! motions of the space
  integer, parameter :: most_damped = 4            !! of these, that dampers oppose most
  integer, parameter :: most_unknowns = 200        !! of the eigenvalue problem, as first-order equations
  integer, parameter :: least_motions = 5          !! smallest number of motions
  real(wp), parameter :: slow_part = 0.25_wp       !! squared frequency of motions that are left out, over the highest [-]

  !> Poles with their motions.
  type :: pole_list
    complex(wp), allocatable :: lambda(:)          !! Im >= 0 [1/s]
    real(wp), allocatable :: x(:, :)               !! (n, poles) of unit modal mass [1/sqrt(kg)]
  end type pole_list

contains

  !> The poles, after an iteration of `fast` for the stiffness.
  subroutine find_fast_poles(m, ev, with_joints, fast, poles, ok)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints                    !! joints and drives act
    type(fast_spectrum), intent(inout) :: fast
    type(pole_list), intent(out) :: poles
    logical, intent(out) :: ok                     !! false: too many sets of terms take part in each motion
    type(reduced_model) :: model
    real(wp), allocatable :: x(:, :)
    integer, allocatable :: group(:)
    integer :: p
    allocate (poles%lambda(0))
    call find_motions(m, ev, with_joints, fast, x)
    call sets_of_terms(m, ev, fast, x, model, group)
    do p = size(x, 2), 1, -1
      if (unknowns(fast, model, group, p) <= most_unknowns) exit
    end do
    ok = p >= min(least_motions, size(x, 2)) .and. p > 0
    if (.not. ok) return
    call project(m, ev, with_joints, fast, group, x(:, 1:p), model)
    call model%find_scale()
    call solve(model, poles, ok)
  end subroutine find_fast_poles

  !> Unknowns of first order of some motions: a spring has one deformation, a material as many as there are motions.
  pure integer function unknowns(fast, model, group, motions) result(total)
    type(fast_spectrum), intent(in) :: fast
    type(reduced_model), intent(in) :: model
    integer, intent(in) :: group(:), motions       !! of each segment its set; motions
    integer :: r, deformations
    total = 2*motions
    do r = 1, size(model%law)
      deformations = count(group == r)
      if (any(group == r .and. fast%lin%segments%element == 0)) deformations = motions
      total = total + min(deformations, motions)*model%law(r)%order()
    end do
  end function unknowns

  !> The sets of terms that take part in the motions; segments whose terms are the same make one set.
  subroutine sets_of_terms(m, ev, fast, x, model, group)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    type(fast_spectrum), intent(in) :: fast
    real(wp), intent(in) :: x(:, :)                !! (n, motions) [1/sqrt(kg)]
    type(reduced_model), intent(inout) :: model
    integer, allocatable, intent(out) :: group(:)  !! (segments) number of its set, 0: it takes no part
    type(fast_mode) :: f
    integer :: k
    logical :: takes_part(size(fast%lin%segments))
    takes_part = .false.
    do k = 1, size(x, 2)
      f%x = x(:, k)
      call fast%quotients(m, ev, f)
      takes_part = takes_part .or. f%segments > no_part*(f%stiffness + sum(f%segments))
    end do
    call number_laws(fast%lin%segments, takes_part, group)
    model%law = [(fast%lin%segments(findloc(group, k, 1))%law, k=1, maxval([0, group]))]
  end subroutine sets_of_terms

  !> A basis of the fastest motions, orthonormal in the mass.
  subroutine find_motions(m, ev, with_joints, fast, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints
    type(fast_spectrum), intent(inout) :: fast
    real(wp), allocatable, intent(out) :: x(:, :)  !! (n, motions) [1/sqrt(kg)]
    real(wp), allocatable :: mx(:, :)              ! mass times them
    real(wp), allocatable :: v(:, :), mv(:, :), part(:, :)   ! motions of an iteration; their parts of its vectors
    real(wp) :: lambda, length
    integer :: p, k, pass, j
    allocate (x(m%s%nq, widest), mx(m%s%nq, widest))
    p = 0
    if (fast%damped) then
      call fast%largest(m, ev, with_joints, only_damping, 100, lambda)
      call append_fastest(min(most_damped, fast%steps))
      call fast%largest(m, ev, with_joints, only_stiffness, 100, lambda)
    end if
    if (with_joints) call append_loops()
    if (fast%steps > 0) call append_fastest(min(widest - p, count(fast%e(1:fast%steps) >= slow_part*fast%e(fast%steps))))
    x = x(:, 1:p)
  contains
    !> Appends the fastest motions of the last iteration.
    subroutine append_fastest(number)
      integer, intent(in) :: number
      part = fast%t(1:fast%steps, fast%steps:fast%steps + 1 - number:-1)
      v = matmul(fast%v(:, 1:fast%steps), part)
      mv = matmul(fast%w(:, 1:fast%steps), part)
      call append()
    end subroutine append_fastest

    !> Appends the motions that forces with an argument start, and those that they see: a fast loop moves in these.
    subroutine append_loops()
      integer :: i, k, side
      do i = 1, size(m%s%forces)
        do k = 1, m%s%forces(i)%item%motions
          if (p + 2 > widest/2) return
          mv = reshape([(0.0_wp, side=1, 2*m%s%nq)], [m%s%nq, 2])
          v = mv
          call argument_motions(m, ev, i, k, mv(:, 1), mv(:, 2))
          do side = 1, 2
            call solve_mass(m, ev, with_joints, mv(:, side), v(:, side))
            length = sqrt(max(dot_product(v(:, side), mv(:, side)), 0.0_wp))
            if (length > sqrt(tiny(1.0_wp))) then
              v(:, side) = v(:, side)/length
              mv(:, side) = mv(:, side)/length
            else                                       ! joints or drives prevent it
              v(:, side) = 0.0_wp
              mv(:, side) = 0.0_wp
            end if
          end do
          call append()
        end do
      end do
    end subroutine append_loops

    !> Appends motions, made orthogonal to those before.
    subroutine append()
      do k = 1, size(v, 2)
        do pass = 1, 2
          do j = 1, p
            length = dot_product(mx(:, j), v(:, k))
            v(:, k) = v(:, k) - length*x(:, j)
            mv(:, k) = mv(:, k) - length*mx(:, j)
          end do
        end do
        length = sqrt(max(dot_product(v(:, k), mv(:, k)), 0.0_wp))
        if (length < 1.0e-6_wp) cycle
        p = p + 1
        x(:, p) = v(:, k)/length
        mx(:, p) = mv(:, k)/length
      end do
    end subroutine append
  end subroutine find_motions

  !> All matrices on the basis. With joints forces that follow the motion of others count: they may feed motions.
  subroutine project(m, ev, with_joints, fast, group, x, model)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    logical, intent(in) :: with_joints
    type(fast_spectrum), intent(in) :: fast
    integer, intent(in) :: group(:)                !! (segments)
    real(wp), intent(in) :: x(:, :)                !! (n, p) [1/sqrt(kg)]
    type(reduced_model), intent(inout) :: model
    real(wp) :: k(size(x, 1)), c(size(x, 1)), parts(size(x, 1), size(model%law))
    type(viscoelastic_terms), allocatable :: law(:)
    integer :: j, r, i, l
    call move_alloc(model%law, law)
    call model%make_room(size(x, 2), law)
    model%basis = x
    do j = 1, model%p
      call fast%products(m, ev, group, x(:, j), k, c, parts)
      do i = 1, merge(size(m%s%forces), 0, with_joints)
        do l = 1, m%s%forces(i)%item%motions
          call argument_pull(m, ev, i, l, x(:, j), k, c)
        end do
      end do
      model%k(:, j) = matmul(k, x)
      model%c(:, j) = matmul(c, x)
      do r = 1, size(model%law)
        model%part(:, j, r) = matmul(parts(:, r), x)
      end do
    end do
  end subroutine project

  !> Poles of all parts that do not couple.
  subroutine solve(model, poles, ok)
    type(reduced_model), intent(inout) :: model
    type(pole_list), intent(inout) :: poles
    logical, intent(out) :: ok
    type(reduced_poles) :: found
    complex(wp) :: v(model%p)
    real(wp), allocatable :: y(:, :)               ! (p, poles) real parts, in the motions of the basis [-]
    integer :: part, i, j
    call model%split_into_parts(usual_unknowns)
    allocate (y(model%p, 0))
    ok = .true.
    do part = 1, model%parts
      call found%find(model, pack([(j, j=1, model%p)], model%label == part), .true., ok)
      if (.not. ok) return
      poles%lambda = [poles%lambda, found%lambda]
      do i = 1, size(found%lambda)
        v = found%shape(:, i)
        v = v/v(maxloc(abs(v), 1))                 ! the largest motion real
        y = reshape([y, real(v, wp)/norm2(real(v, wp))], [model%p, size(y, 2) + 1])
      end do
    end do
    allocate (poles%x(size(model%basis, 1), size(y, 2)))
    do i = 1, size(y, 2)
      poles%x(:, i) = matmul(model%basis, y(:, i))
    end do
  end subroutine solve
end module fast_poles
