!> Eigenvalues of the damped mechanism on the space of its fastest motions: the fastest modes of the instantaneous stiffness, and
!> the motions that dampers oppose most, and those that controllers act on and sense. Damping, viscoelastic terms and loops couple
!> these motions; the eigenvalues of one motion alone are not those of the mechanism. Controllers take part with their states.
module fast_poles
  use closed_loops, only: loop_system
  use controller, only: free
  use kinds, only: half_digits, wp
  use evaluation_results, only: evaluation
  use linear_matrices, only: number_laws
  use mass_solve, only: remove_joint_forces, solve_mass
  use mechanism, only: mechanism_model
  use reduced_system, only: first_order, reduced_model, reduced_poles, usual_unknowns
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
    complex(wp), allocatable :: open(:)            !! poles with the loops of all controllers open; none without controllers [1/s]
    real(wp) :: growth = 0.0_wp                    !! of the motion that grows fastest [1/s]
    integer, allocatable :: controller(:)          !! (poles) the one whose forces do most work, 0: there is none
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
    type(loop_system) :: loops
    type(pole_list) :: closed
    real(wp), allocatable :: x(:, :)
    integer, allocatable :: group(:)
    integer :: p, states                           ! motions, states of controllers
    allocate (poles%lambda(0))
    states = 0
    if (with_joints .and. size(m%s%controllers) > 0) then
      call loops%build(m, ev, [(0.0_wp, p=1, m%s%nq)])
      states = sum(loops%law%states)
    end if
    call find_motions(m, ev, with_joints, fast, loops, x)
    call sets_of_terms(m, ev, fast, x, model, group)
    do p = size(x, 2), 1, -1
      if (unknowns(fast, model, group, p) <= most_unknowns) exit
    end do
    ok = p >= min(least_motions, size(x, 2)) .and. p + states > 0
    if (.not. ok) return
    call project(m, ev, with_joints, fast, group, x(:, 1:p), model)
    call model%find_scale()
    call solve(model, poles, ok)
    if (loops%n == 0 .or. .not. ok) return
    call solve(model, closed, ok, loops)
    call move_alloc(poles%lambda, closed%open)
    poles = closed
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
  subroutine find_motions(m, ev, with_joints, fast, loops, x)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints
    type(fast_spectrum), intent(inout) :: fast
    type(loop_system), intent(in) :: loops
    real(wp), allocatable, intent(out) :: x(:, :)  !! (n, motions) [1/sqrt(kg)]
    real(wp), allocatable :: mx(:, :)              ! mass times them
    real(wp), allocatable :: v(:, :), mv(:, :), part(:, :)   ! motions of an iteration; their parts of its vectors
    real(wp) :: lambda, length
    integer :: p, k, pass, j, most
    most = widest
    if (with_joints) most = min(widest + 2*sum([(m%s%forces(k)%item%motions, k=1, size(m%s%forces))]), most_unknowns/2)
    allocate (x(m%s%nq, most), mx(m%s%nq, most))
    p = 0
    if (fast%damped) then
      call fast%largest(m, ev, with_joints, only_damping, 100, lambda)
      call append_fastest(min(most_damped, fast%steps))
      call fast%largest(m, ev, with_joints, only_stiffness, 100, lambda)
    end if
    if (with_joints) call append_loops()
    if (fast%steps > 0) call append_fastest(min(most - p, count(fast%e(1:fast%steps) >= slow_part*fast%e(fast%steps))))
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

    !> Appends the motions that controllers and forces with an argument start, and those that they see: a fast loop moves in these.
    subroutine append_loops()
      real(wp), dimension(m%s%nq) :: acts, places, rates
      integer :: i, l
      do i = 1, loops%n
        call append_pair(loops%b(:, i), merge(loops%rate(:, i), loops%place(:, i), loops%law(i)%quantity%rate))
      end do
      do i = 1, size(m%s%forces)
        do l = 1, merge(m%s%forces(i)%item%motions, 0, m%s%forces(i)%item%controller == 0)
          call argument_motions(m, ev, i, l, acts, places, rates)
          call append_pair(acts, merge(rates, places, m%s%forces(i)%item%arguments(l)%item%rate))
        end do
      end do
    end subroutine append_loops

    !> Appends the motions that two forces start.
    subroutine append_pair(acts, sees)
      real(wp), intent(in) :: acts(:), sees(:)     !! (n) [N, N m]
      real(wp) :: free_length                      ! without joints
      integer :: side
      if (p + 2 > most) return
      mv = reshape([acts, sees], [m%s%nq, 2])
      v = mv
      do side = 1, 2
        call solve_mass(m, ev, .false., mv(:, side), v(:, side))
        free_length = sqrt(max(dot_product(v(:, side), mv(:, side)), tiny(1.0_wp)))
        call solve_mass(m, ev, with_joints, mv(:, side), v(:, side))
        call remove_joint_forces(m, ev, mv(:, side))
        length = sqrt(max(dot_product(v(:, side), mv(:, side)), 0.0_wp))
        if (length > half_digits*free_length) then
          v(:, side) = v(:, side)/length
          mv(:, side) = mv(:, side)/length
        else                                       ! joints or drives prevent it
          v(:, side) = 0.0_wp
          mv(:, side) = 0.0_wp
        end if
      end do
      call append()
    end subroutine append_pair

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

  !> All matrices on the basis. With joints forces that follow the motion of others count: they may feed motions. Controllers, which
  !> have states, come later.
  subroutine project(m, ev, with_joints, fast, group, x, model)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
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
      model%k(:, j) = matmul(k, x)
      model%c(:, j) = matmul(c, x)
      do r = 1, size(model%law)
        model%part(:, j, r) = matmul(parts(:, r), x)
      end do
    end do
    do i = 1, merge(size(m%s%forces), 0, with_joints)
      do l = 1, merge(m%s%forces(i)%item%motions, 0, m%s%forces(i)%item%controller == 0)
        call add_argument(i, l)
      end do
    end do
  contains
    !> Adds a force that follows a motion, where it acts in a motion and sees one by more than rounding.
    subroutine add_argument(i, l)
      integer, intent(in) :: i, l                  !! force element, argument
      real(wp), dimension(size(x, 1)) :: acts, places, rates
      logical :: acting(size(x, 2)), seeing(size(x, 2))
      integer :: j
      call argument_motions(m, ev, i, l, acts, places, rates)
      acting = is_more_than_rounding(acts)
      seeing = is_more_than_rounding(places) .or. is_more_than_rounding(rates)
      do j = 1, size(x, 2)
        if (.not. seeing(j)) cycle
        k = 0.0_wp
        c = 0.0_wp
        call argument_pull(m, ev, i, l, x(:, j), k, c)
        model%k(:, j) = model%k(:, j) + merge(matmul(k, x), 0.0_wp, acting)
        model%c(:, j) = model%c(:, j) + merge(matmul(c, x), 0.0_wp, acting)
      end do
    end subroutine add_argument

    !> Whether a force has parts in the motions that are more than rounding, beside what it would do to free bodies.
    function is_more_than_rounding(force) result(yes)
      real(wp), intent(in) :: force(:)             !! (n) [N], [N m]
      logical :: yes(size(x, 2))
      real(wp) :: v(size(force))                   ! [m/s2], [rad/s2]
      yes = .false.
      if (.not. any(abs(force) > 0.0_wp)) return
      call solve_mass(m, ev, .false., force, v)
      yes = abs(matmul(force, x)) > half_digits*sqrt(max(dot_product(v, force), 0.0_wp))
    end function is_more_than_rounding
  end subroutine project

  !> Poles of all parts that do not couple; with closed loops all motions make one part.
  subroutine solve(model, poles, ok, loops)
    type(reduced_model), intent(inout) :: model
    type(pole_list), intent(out) :: poles
    logical, intent(out) :: ok
    type(loop_system), intent(in), optional :: loops
    type(reduced_poles) :: found
    complex(wp) :: v(model%p)
    real(wp), allocatable :: y(:, :)               ! (p, poles) real parts, in the motions of the basis [-]
    real(wp), allocatable :: a(:, :)               ! the system of first order with closed loops [1/s]
    integer :: part, i, j
    allocate (poles%lambda(0), poles%open(0))
    allocate (y(model%p, 0))
    if (present(loops)) then
      model%label = 1
      model%parts = 1
      call first_order(model, [(j, j=1, model%p)], .true., a)
      call loops%add_loops(model, 0, a)
    else
      call model%split_into_parts(usual_unknowns)
    end if
    ok = .true.
    do part = 1, model%parts
      call found%find(model, pack([(j, j=1, model%p)], model%label == part), .true., ok, a)
      if (.not. ok) return
      poles%growth = max(poles%growth, maxval(found%lambda%re, found%lambda%re > half_digits*abs(found%lambda)))
      found%lambda%re = min(found%lambda%re, 0.0_wp)   ! one that loops or forces over the motion make grow bounds steps, too
      poles%lambda = [poles%lambda, found%lambda]
      do i = 1, size(found%lambda)
        v = found%shape(:, i)
        if (model%p > 0) v = v/v(maxloc(abs(v), 1))   ! the largest motion real
        y = reshape([y, real(v, wp)/norm2(real(v, wp))], [model%p, size(y, 2) + 1])
      end do
    end do
    allocate (poles%x(size(model%basis, 1), size(y, 2)))
    allocate (poles%controller(size(y, 2)), source=0)
    do i = 1, size(y, 2)
      poles%x(:, i) = matmul(model%basis, y(:, i))
      if (present(loops)) poles%controller(i) = busiest(loops, poles%lambda(i), poles%x(:, i))
    end do
  end subroutine solve

  !> The controller whose forces do most work in a motion of a pole; where nothing moves the one whose own pole it is.
  pure integer function busiest(loops, lambda, x) result(most)
    type(loop_system), intent(in) :: loops
    complex(wp), intent(in) :: lambda              !! [1/s]
    real(wp), intent(in) :: x(:)                   !! (n) [1/sqrt(kg)]
    real(wp) :: answer(loops%n), work(loops%n)     ! outputs [any], [1/s2]
    integer :: k
    do k = 1, loops%n
      answer(k) = abs(loops%law(k)%response(free, lambda))
      work(k) = answer(k)*abs(dot_product(loops%b(:, k), x) &
                              *(dot_product(loops%place(:, k), x) + lambda*dot_product(loops%rate(:, k), x)))
    end do
    most = maxloc(merge(work, answer, any(work > 0.0_wp)), 1)
  end function busiest
end module fast_poles
