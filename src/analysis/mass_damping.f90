!> Whether damping in proportion to mass damps a body as the reference of its frame lets it. C acts on the motion against the frame
!> (theory.md, section 3). The modes of the body as its joints hold it would lose alpha/(2 omega) if it acted on the whole motion.
!> Bodies that welds join are one here. What other bodies joints hold them to, rests.
module mass_damping
  use kinds, only: half_digits, wp, pi
  use body, only: body_model
  use element_law, only: inertia_of
  use held_body, only: held_body_model, held_modes, hold_bodies, rigid_mass
  use layered_element, only: element_inertia
  use linear_state, only: evaluate_state
  use linearisation, only: joint_rows_matrix
  use scene_run, only: run_state
  use summary_text, only: summary_record
  use text, only: either, to_text
  use triplets, only: triplet_matrix
  implicit none (type, external)
  private
  public :: warn_of_mass_damping

  real(wp), parameter :: told = 0.1_wp               !! difference of a damping ratio [-]
  integer, parameter :: compared = 3                 !! modes as the joints hold them
  integer, parameter :: most_nodes = 6               !! of the nodes at which joints hold a body, that make references

  !> A way to fix the frame to the nodes: to one node, to two, or to none (mean axes).
  type :: reference_choice
    integer :: node = 0                              !! its u and v, and its rotation if there is no second
    integer :: second = 0                            !! its v
  end type reference_choice

contains

  !> One warning for each group of bodies that is damped otherwise by more than a tenth.
  subroutine warn_of_mass_damping(run, text)
    type(run_state), intent(inout) :: run
    type(summary_record), intent(inout) :: text
    type(held_body_model), allocatable :: members(:)
    type(triplet_matrix) :: joints
    integer :: group(size(run%sys%m%s%bodies)), b, k
    logical :: ok
    associate (bodies => run%sys%m%s%bodies)
      if (.not. any([(damped_by_mass(bodies(b)), b=1, size(bodies))])) return
      call evaluate_state(run%sys, run%sys%options, run%y)
      call joint_rows_matrix(run%sys%m, run%sys%ev, joints)
      group = welded_groups(run)
      do b = 1, size(bodies)
        if (group(b) /= b) cycle
        if (.not. any([(group(k) == b .and. damped_by_mass(bodies(k)), k=1, size(bodies))])) cycle
        call hold_bodies(run%sys%m, pack([(k, k=1, size(bodies))], group == b), joints, members, ok)
        if (ok) call judge(run, members, text)
      end do
    end associate
  end subroutine warn_of_mass_damping

  !> Whether a material of the body damps in proportion to mass.
  pure logical function damped_by_mass(b) result(yes)
    type(body_model), intent(in) :: b
    integer :: k
    yes = .false.
    if (.not. b%flexible) return
    do k = 1, size(b%layers%sections)
      yes = yes .or. any(b%layers%sections(k)%layers%ray_m > 0.0_wp)
    end do
  end function damped_by_mass

  !> The first body of those that welds join with each flexible one; 0 of rigid ones.
  pure function welded_groups(run) result(group)
    type(run_state), intent(in) :: run
    integer :: group(size(run%sys%m%s%bodies))
    integer :: k, a, b
    group = merge([(k, k=1, size(group))], 0, run%sys%m%s%bodies%flexible)
    do k = 1, size(run%d%joints)
      if (run%d%joints(k)%type /= 'weld') cycle
      a = run%d%joints(k)%a%body
      b = run%d%joints(k)%b%body
      if (a == 0 .or. b == 0) cycle
      if (group(a) == 0 .or. group(b) == 0) cycle
      a = group(a)
      b = group(b)
      where (group == max(a, b)) group = min(a, b)
    end do
  end function welded_groups

  !> Nodes of a body at which joints act.
  pure function held_nodes(run, number) result(nodes)
    type(run_state), intent(in) :: run
    integer, intent(in) :: number                    !! of the body
    integer, allocatable :: nodes(:)
    integer :: k
    associate (j => run%d%joints)
      nodes = [pack(j%a%node, j%a%body == number .and. j%a%node > 0), pack(j%b%node, j%b%body == number .and. j%b%node > 0)]
    end associate
    nodes = [1, run%sys%m%s%bodies(number)%nn, nodes]
    nodes = pack(nodes, [(.not. any(nodes(:k - 1) == nodes(k)), k=1, size(nodes))])
    nodes = nodes(:min(size(nodes), most_nodes))
  end function held_nodes

  !> Compares the modes of a group with what their damping would be if it acted on all of their motion, for each reference.
  subroutine judge(run, members, text)
    type(run_state), intent(in) :: run
    type(held_body_model), intent(in) :: members(:)
    type(summary_record), intent(inout) :: text
    type(reference_choice), allocatable :: choices(:)
    real(wp), allocatable :: omega2(:), x(:, :)
    real(wp), allocatable :: loss(:, :)              ! (modes, whole motion, present reference, choices) [1/s]
    real(wp) :: off                                  ! largest difference of a choice [-]
    integer :: k, c, best, first, modes              ! first: mode that differs
    call held_modes(members, omega2, x)
    modes = min(compared, size(omega2))
    if (modes == 0) return
    choices = possible_references(members, held_nodes(run, members(1)%number))
    allocate (loss(modes, size(choices) + 2), source=0.0_wp)
    do k = 1, size(members)
      call add_losses(members(k), choices, x(members(k)%before + 1:members(k)%before + 3 + members(k)%b%nf, :modes), loss)
    end do
    first = findloc(abs(loss(:, 2)/loss(:, 1) - 1) > told, .true., 1)
    if (first == 0) return
    off = huge(1.0_wp)
    best = 0
    do c = 1, size(choices)
      associate (differs => maxval(abs(loss(:, 2 + c)/loss(:, 1) - 1)))
        if (.not. differs < off - half_digits) cycle
        off = differs
        best = c
      end associate
    end do
    associate (omega => sqrt(omega2(first)))
      call text%warn(named(members)//' has rayleigh_mass, which damps its motion against its frame alone: as its joints hold '// &
                     'it, its mode of '//to_text(omega/(2*pi))//' Hz has the damping ratio '//to_text(loss(first, 2)/(2*omega))// &
                     ' of it, alpha/(2 omega) is '//to_text(loss(first, 1)/(2*omega))//'; '// &
                     advice(run, members, choices(best), off, to_text(loss(first, 2 + best)/(2*omega))))
    end associate
  end subroutine judge

  !> What to do.
  function advice(run, members, choice, off, ratio) result(words)
    type(run_state), intent(in) :: run
    type(held_body_model), intent(in) :: members(:)
    type(reference_choice), intent(in) :: choice     !! the best
    real(wp), intent(in) :: off                      !! how far it differs [-]
    character(*), intent(in) :: ratio                !! damping ratio with it
    character(:), allocatable :: words, node
    associate (b => run%sys%m%s%bodies(members(1)%number))
      if (choice%node == 0) then
        words = 'reference=''free'''//either(' (with modes)', '', b%basis%reduced_from == 0)
      else if (choice%node == 1 .and. choice%second == 0) then
        words = 'reference=''clamped'''
      else if (choice%node == 1 .and. choice%second == b%nn) then
        words = 'reference=''pinned'''
      else
        node = to_text(choice%node)
        words = 'reference_node='//node//','//node//','//to_text(merge(choice%second, choice%node, choice%second > 0))// &
                ' reference_dof=''u'',''v'','''//either('v', 'r', choice%second > 0)//''''
      end if
    end associate
    if (off <= told) then
      words = words//' has '//ratio
    else
      words = 'no reference agrees (the nearest, '//words//', has '//ratio//'): its frame moves with it'// &
              either('; one body in place of welded ones has less of that', '', size(members) > 1)
    end if
  end function advice

  !> Names of the bodies of a group.
  function named(members) result(words)
    type(held_body_model), intent(in) :: members(:)
    character(:), allocatable :: words
    words = 'body "'//trim(members(1)%b%name)//'"'
    if (size(members) > 1) words = words//' (welded to '//to_text(size(members) - 1)//' more)'
  end function named

  !> References between which to choose: of one body by the nodes at which it is held, of several by the words of the deck.
  pure function possible_references(members, nodes) result(choices)
    type(held_body_model), intent(in) :: members(:)
    integer, intent(in) :: nodes(:)                  !! at which joints hold the first body
    type(reference_choice), allocatable :: choices(:)
    integer :: i, j
    associate (b => members(1)%b)
      if (size(members) > 1) then
        choices = [reference_choice(1, 0), reference_choice(1, -1), reference_choice(0, 0)]
        return
      end if
      choices = [reference_choice(1, 0), reference_choice(1, b%nn), reference_choice(0, 0)]
      do i = 1, size(nodes)
        if (nodes(i) /= 1) choices = [choices, reference_choice(nodes(i), 0)]
        do j = 1, size(nodes)
          if (j == i .or. (nodes(i) == 1 .and. nodes(j) == b%nn)) cycle
          if (abs(b%x(1, nodes(j)) - b%x(1, nodes(i))) > half_digits*b%length) choices = [choices, &
                                                                                   reference_choice(nodes(i), nodes(j))]
        end do
      end do
    end associate
  end function possible_references

  !> Adds a body's part of x^T C x: C on the whole motion, against its present frame, and against the frame of each choice.
  subroutine add_losses(x, choices, shapes, loss)
    type(held_body_model), intent(in) :: x
    type(reference_choice), intent(in) :: choices(:)
    real(wp), intent(in) :: shapes(:, :)             !! (3 + nf, modes) frame and elastic coordinates [m, rad, over kg^.5 m]
    real(wp), intent(inout) :: loss(:, :)            !! (modes, 2 + choices) [1/s]
    type(element_inertia) :: inertia
    real(wp) :: frame(3, 2 + size(choices), size(shapes, 2))   ! rigid motion that is taken away [m, m, rad]
    real(wp), dimension(size(x%b%edof, 1)) :: a, rest   ! coordinates of an element [m, rad]
    real(wp) :: mean(3, 3)                           ! of rigid motions [kg, kg m, kg m2]
    integer :: k, c, e
    mean = rigid_mass(x%b)
    do k = 1, size(shapes, 2)
      frame(:, 1, k) = 0.0_wp
      frame(:, 2, k) = shapes(:3, k)
      do c = 1, size(choices)
        frame(:, 2 + c, k) = shapes(:3, k) + moved_frame(x%b, choices(c), shapes(4:, k), mean)
      end do
    end do
    do e = 1, x%b%ne
      inertia = inertia_of(x%b, e)
      do k = 1, size(shapes, 2)
        a = x%b%basis%element_coordinates(x%b, e, shapes(4:, k))
        call add_rigid(x%b, e, shapes(:3, k), a)
        do c = 1, size(loss, 2)
          rest = a
          call add_rigid(x%b, e, -frame(:, c, k), rest)
          loss(k, c) = loss(k, c) + dot_product(rest, matmul(inertia%c, rest))
        end do
      end do
    end do
  end subroutine add_losses

  !> Adds a rigid motion to the coordinates of an element's ends.
  pure subroutine add_rigid(b, e, motion, a)
    type(body_model), intent(in) :: b
    integer, intent(in) :: e                         !! element
    real(wp), intent(in) :: motion(3)                !! [m, m, rad]
    real(wp), intent(inout) :: a(:)                  !! body axes [m, rad]
    integer :: k
    do k = 1, 2
      associate (x => b%x(:, b%en(k, e)))
        a(3*k - 2:3*k) = a(3*k - 2:3*k) + [motion(1) - motion(3)*x(2), motion(2) + motion(3)*x(1), motion(3)]
      end associate
    end do
  end subroutine add_rigid

  !> The rigid part of an elastic motion that another frame would follow.
  pure function moved_frame(b, choice, q, mean) result(motion)
    type(body_model), intent(in) :: b
    type(reference_choice), intent(in) :: choice
    real(wp), intent(in) :: q(:)                     !! (nf) [m, rad, over kg^.5 m]
    real(wp), intent(in) :: mean(3, 3)               !! mass of rigid motions [kg, kg m, kg m2]
    real(wp) :: motion(3)                            !! [m, m, rad]
    real(wp) :: u(3), v(3), x(2)
    integer :: last
    if (choice%node == 0) then                       ! the momentum of the rest is zero
      motion = solved(mean, [matmul(q, b%shape%sbar), dot_product(q, b%shape%c0)])
      return
    end if
    u = b%displacement(choice%node, q)
    x = b%x(:, choice%node)
    if (choice%second /= 0) then
      last = merge(choice%second, b%nn, choice%second > 0)
      v = b%displacement(last, q)
      u(3) = (v(2) - u(2))/(b%x(1, last) - x(1))
    end if
    motion = [u(1) + u(3)*x(2), u(2) - u(3)*x(1), u(3)]
  end function moved_frame

  !> Solves A x = b of three unknowns by Cramer's rule.
  pure function solved(a, b) result(x)
    real(wp), intent(in) :: a(3, 3), b(3)            !! [kg, kg m, kg m2], [kg m, kg m2]
    real(wp) :: x(3)                                 !! [m, m, rad]
    real(wp) :: c(3, 3)
    integer :: k
    do k = 1, 3
      c = a
      c(:, k) = b
      x(k) = determinant(c)/determinant(a)
    end do
  contains
    !> Of three columns.
    pure real(wp) function determinant(c) result(d)  ! [any]
      real(wp), intent(in) :: c(3, 3)                !! [any]
      d = c(1, 1)*(c(2, 2)*c(3, 3) - c(2, 3)*c(3, 2)) - c(1, 2)*(c(2, 1)*c(3, 3) - c(2, 3)*c(3, 1)) &
          + c(1, 3)*(c(2, 1)*c(3, 2) - c(2, 2)*c(3, 1))
    end function determinant
  end function solved
end module mass_damping
