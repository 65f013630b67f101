!> One Newton iteration of an implicit step: residual, tangent condensed body by body onto the frames and from there onto
!> the rows, and the correction. Nothing of the size of a body squared is formed; nothing is allocated.
module implicit_newton
  use kinds, only: wp
  use constraint, only: place_stiffness
  use dynamics, only: set_frames, place_kinematics, constraint_values, applied_forces
  use implicit_blocks, only: base_block, exact_block, elastic_solve, elastic_columns
  use implicit_bodies, only: body_residual, body_tangent
  use implicit_condensation, only: condense_frame, condense_rows
  use implicit_ghm, only: spring_state, spring_stiffness
  use implicit_model, only: implicit_solver, implicit_body
  use implicit_rows, only: from_joint, from_spring, factor_rows
  use load, only: load_force, load_about, axes_body, axes_section
  use mechanism, only: mechanism_model
  use place, only: turn
  implicit none (type, external)
  private
  public :: trial_residual, trial_tangent, trial_elastic, constant_blocks

contains

  !> Factors the constant elastic blocks of all bodies for the present step size.
  subroutine constant_blocks(self, m, bad)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    logical, intent(out) :: bad
    integer :: b
    bad = .false.
    do b = 1, size(self%b)
      if (self%b(b)%nf == 0) cycle
      call base_block(self%b(b), m%s%bodies(b), self%now, bad)
      if (bad) return
      call elastic_columns(self%b(b), m%s%bodies(b), m%s%places, .false.)
      self%constant_factors = self%constant_factors + 1
    end do
  end subroutine constant_blocks

  !> Residuals of all bodies (t%rr, t%ff) and constraints (m%rows%phi) at the trial state.
  subroutine trial_residual(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(inout) :: m
    real(wp), intent(in) :: t                !! end of the step [s]
    integer :: b, i, n
    call set_frames(m, self%q1)
    call place_kinematics(m, self%q1, self%v1)
    call spring_state(self, m)
    call applied_forces(m, t, self%q1, self%spring_z, self%spring_zd)
    call constraint_values(m, t)
    call place_forces(self, m)
    do b = 1, size(self%b)
      i = m%s%qo(b)
      n = i + 3 + self%b(b)%nf
      call body_residual(self%b(b), m%s%bodies(b), self%q1(i + 1:n), self%v1(i + 1:n), self%vd1(i + 1:n), &
                         frame_acceleration(self, m, b))
    end do
    do i = 1, size(m%s%places)
      b = m%s%places(i)%body
      if (b > 0) call add_place_force(self%b(b), m, i, self%fp(:, i))
    end do
  end subroutine trial_residual

  !> A^T (R'' - g) of a body [m/s2].
  pure function frame_acceleration(self, m, b) result(x)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: b
    real(wp) :: x(2), g(2)
    g = self%vd1(m%s%qo(b) + 1:m%s%qo(b) + 2) - m%s%gravity
    x(1) = m%c(b)*g(1) + m%sn(b)*g(2)
    x(2) = m%c(b)*g(2) - m%sn(b)*g(1)
  end function frame_acceleration

  !> Residual force (body axes) and moment on every place: multipliers' minus applied ones.
  subroutine place_forces(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: k, i
    self%fp = -m%wrench
    do k = 1, size(m%s%constraints)
      associate (c => m%s%constraints(k)%item, r => m%rows)
        do i = c%first, c%first + c%rows - 1
          call push(c%ia, r%na(:, i), r%sa(i), self%lambda1(i))
          call push(c%ib, r%nb(:, i), r%sb(i), self%lambda1(i))
        end do
      end associate
    end do
  contains
    !> Adds a unit wrench times a multiplier.
    subroutine push(place, n, s, x)
      integer, intent(in) :: place
      real(wp), intent(in) :: n(2), s, x
      integer :: b
      b = m%s%places(place)%body
      if (b == 0) return
      self%fp(1, place) = self%fp(1, place) + x*(m%c(b)*n(1) + m%sn(b)*n(2))
      self%fp(2, place) = self%fp(2, place) + x*(m%c(b)*n(2) - m%sn(b)*n(1))
      self%fp(3, place) = self%fp(3, place) + x*s
    end subroutine push
  end subroutine place_forces

  !> A place's residual wrench on frame and elastic coordinates.
  pure subroutine add_place_force(t, m, k, f)
    type(implicit_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k                 !! place
    real(wp), intent(in) :: f(3)             !! body axes
    integer :: c, i
    t%rr(1:2) = t%rr(1:2) + f(1:2)
    t%rr(3) = t%rr(3) + f(3) + m%p%rho(1, k)*f(2) - m%p%rho(2, k)*f(1)
    if (t%nf == 0) return
    associate (place => m%s%places(k))
      if (allocated(place%psi)) then
        do i = 1, t%nf
          t%ff(i) = t%ff(i) + place%psi(1, i)*f(1) + place%psi(2, i)*f(2) + place%psi(3, i)*f(3)
        end do
      else
        do c = 1, 3
          i = place%dof(c)
          if (i > 0) t%ff(i) = t%ff(i) + f(c)
        end do
      end if
    end associate
  end subroutine add_place_force

  !> Tangent at the trial state (after trial_residual): borders, exact blocks where asked, elastic solves of residual and
  !> columns, condensed frames, rows.
  subroutine trial_tangent(self, m, t, bad)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: t                !! [s]
    logical, intent(out) :: bad
    integer :: b, i, n, k
    bad = .false.
    do b = 1, size(self%b)
      i = m%s%qo(b)
      n = i + 3 + self%b(b)%nf
      call body_tangent(self%b(b), m%s%bodies(b), self%now, self%q1(i + 1:n), self%v1(i + 1:n), self%vd1(i + 1:n), &
                        frame_acceleration(self, m, b))
    end do
    do k = 1, size(m%s%places)
      b = m%s%places(k)%body
      if (b > 0) call add_turning(self%b(b), m, k, self%fp(:, k))
    end do
    call followers(self, m, t)
    call laws(self, m, t)
    do b = 1, size(self%b)
      if (self%b(b)%nf > 0) then
        i = m%s%qo(b)
        if (self%exact) then
          call exact_block(self%b(b), m%s%bodies(b), self%now, self%v1(i + 3), self%vd1(i + 3), bad)
          if (bad) return
          self%exact_factors = self%exact_factors + 1
        end if
        ! columns that an earlier step solved with its exact block do not fit the constant one
        if (self%exact .or. self%b(b)%exact_columns) call elastic_columns(self%b(b), m%s%bodies(b), m%s%places, self%exact)
        call elastic_solve(self%b(b), m%s%bodies(b), self%exact, .true.)
      end if
      call condense_frame(self%b(b), m, b, self%now%c1, bad)
      if (bad) return
    end do
    call condense_rows(self, m)
    call factor_rows(self%rows)
    bad = self%rows%bad
  end subroutine trial_tangent

  !> Residual wrenches on places turn with the body: theta-theta, theta-f and f-theta terms.
  pure subroutine add_turning(t, m, k, f)
    type(implicit_body), intent(inout) :: t
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: k
    real(wp), intent(in) :: f(3)
    integer :: i
    t%trr(3, 3) = t%trr(3, 3) - m%p%rho(1, k)*f(1) - m%p%rho(2, k)*f(2)
    if (t%nf == 0) return
    associate (place => m%s%places(k))
      if (allocated(place%psi)) then
        do i = 1, t%nf
          t%col(i) = t%col(i) + place%psi(1, i)*f(2) - place%psi(2, i)*f(1)
          t%row(i) = t%row(i) + place%psi(1, i)*f(2) - place%psi(2, i)*f(1)
        end do
      else
        i = place%dof(1)
        if (i > 0) then
          t%col(i) = t%col(i) + f(2)
          t%row(i) = t%row(i) + f(2)
        end if
        i = place%dof(2)
        if (i > 0) then
          t%col(i) = t%col(i) - f(1)
          t%row(i) = t%row(i) - f(1)
        end if
      end if
    end associate
  end subroutine add_turning

  !> Forces that turn with the body's frame: constant in body axes, so their part of add_turning in the columns goes.
  subroutine followers(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: t
    real(wp) :: force(2), moment, f(2)
    integer :: k, b, i
    do k = 1, size(m%s%loads)
      associate (l => m%s%loads(k))
        if (.not. l%acts(m%stage) .or. l%kind /= load_force .or. l%axes /= axes_body) cycle
        b = m%s%places(l%place)%body
        if (b == 0) cycle
        call l%wrench(m%p, self%q1(m%s%qo(b) + 3), l%scale(t, m%left)*m%load_factor, force, moment)
        f = [m%c(b)*force(1) + m%sn(b)*force(2), m%c(b)*force(2) - m%sn(b)*force(1)]
        associate (x => self%b(b), place => m%s%places(l%place))
          x%trr(1, 3) = x%trr(1, 3) + f(2)
          x%trr(2, 3) = x%trr(2, 3) - f(1)
          x%trr(3, 3) = x%trr(3, 3) - dot_product(m%p%rho(:, l%place), f)
          if (x%nf == 0) cycle
          if (allocated(place%psi)) then
            do i = 1, x%nf
              x%col(i) = x%col(i) + place%psi(1, i)*f(2) - place%psi(2, i)*f(1)
            end do
          else
            x%col(place%dof(1)) = x%col(place%dof(1)) + f(2)
            x%col(place%dof(2)) = x%col(place%dof(2)) - f(1)
          end if
        end associate
      end associate
    end do
  end subroutine followers

  !> Place-level tangents of curved joints, springs and loads.
  subroutine laws(self, m, t)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: t
    type(place_stiffness) :: p
    integer :: k
    do k = 1, size(self%rows%laws)
      associate (law => self%rows%laws(k))
        select case (law%kind)
        case (from_joint)
          call m%s%constraints(law%item)%item%geometric(m%p, self%lambda1, p)
          law%k = p%k
        case (from_spring)
          call m%s%springs(law%item)%tangent(m%p, spring_stiffness(self, m, law%item), m%s%springs(law%item)%damping, &
                                             m%spring_force(law%item), p)
          law%k = p%k + self%now%c2*p%c
          law%g = p%c
        case default
          call load_law(self, m, law%item, t, law%k)
        end select
      end associate
    end do
  end subroutine laws

  !> Torques about a centre and forces that follow a section.
  pure subroutine load_law(self, m, item, t, k)
    type(implicit_solver), intent(in) :: self
    type(mechanism_model), intent(in) :: m
    integer, intent(in) :: item
    real(wp), intent(in) :: t
    real(wp), intent(out) :: k(6, 6)
    real(wp) :: force(2), moment, scale, d(2), n2
    k = 0.0_wp
    associate (l => m%s%loads(item))
      if (.not. l%acts(m%stage)) return
      scale = l%scale(t, m%left)*m%load_factor
      call l%wrench(m%p, self%q1(m%s%qo(m%s%places(l%place)%body) + 3), scale, force, moment)
      if (l%kind == load_about) then
        d = m%p%r(:, l%place) - l%centre
        n2 = max(dot_product(d, d), (epsilon(1.0_wp)*m%s%size)**2)
        k(1:2, 1) = -scale*l%moment*([0.0_wp, 1.0_wp]/n2 - 2*turn(d)*(d(1)/n2)/n2)
        k(1:2, 2) = -scale*l%moment*([-1.0_wp, 0.0_wp]/n2 - 2*turn(d)*(d(2)/n2)/n2)
      else if (l%axes == axes_section) then
        k(1:2, 3) = -turn(force)
      end if
    end associate
  end subroutine load_law

  !> Elastic solves of the residual with the factors that stand (later iterations of a step).
  subroutine trial_elastic(self, m)
    type(implicit_solver), intent(inout) :: self
    type(mechanism_model), intent(in) :: m
    integer :: b
    do b = 1, size(self%b)
      if (self%b(b)%nf > 0) call elastic_solve(self%b(b), m%s%bodies(b), self%exact, .false.)
    end do
  end subroutine trial_elastic
end module implicit_newton
