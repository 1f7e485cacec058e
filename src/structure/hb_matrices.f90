!> Structure given by its matrices, for instance from another program or from a paper.
module hb_matrices
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_properties, only: properties_t
   use hb_proportional_damping, only: proportional_damping_t, read_proportional_damping
   use hb_structure, only: check_room, label_length, new_structure, structure_t
   use hb_text, only: string_t, to_text
   implicit none
   private
   public :: read_matrices

contains

   !> Reads the matrices from the keys of their group `&structure`.
   !>
   !> Each matrix is written row by row with n_dofs**2 numbers, or as the n_dofs numbers of its diagonal.
   !> Labels are x1, x2, ... and units `m` unless they are given.
   subroutine read_matrices(group, structure, error, memory_limit)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(out) :: structure
      type(error_t), allocatable, intent(out) :: error
      real(wp), intent(in), optional :: memory_limit         !! bytes
      type(proportional_damping_t) :: proportional
      type(string_t), allocatable :: labels(:), units(:)
      real(wp), allocatable :: damping(:), gyroscopic(:), mass(:), stiffness(:)
      integer :: i, n_dofs

      call group%get("n_dofs", n_dofs)
      allocate (labels(max(n_dofs, 0)), units(max(n_dofs, 0)))
      do i = 1, n_dofs
         labels(i)%value = "x"//to_text(i)
      end do
      mass = [(0.0_wp, i=1, n_dofs)]
      damping = mass
      gyroscopic = mass
      stiffness = mass
      call group%get("mass", mass)
      call group%get("damping", damping)
      call group%get("gyroscopic", gyroscopic)
      call group%get("stiffness", stiffness)
      call group%get("labels", labels)
      call group%get("units", units)
      call read_proportional_damping(group, proportional)
      if (n_dofs > 0) then
         call check_matrix(group, "mass", mass, n_dofs)
         call check_matrix(group, "damping", damping, n_dofs)
         call check_matrix(group, "gyroscopic", gyroscopic, n_dofs)
         call check_matrix(group, "stiffness", stiffness, n_dofs)
      end if
      call group%finish(error)
      if (allocated(error)) return
      call check_room(n_dofs, error, memory_limit)
      if (.not. allocated(error)) then
         associate (m => full(mass, n_dofs), d => full(damping, n_dofs), g => full(gyroscopic, n_dofs), &
                    k => full(stiffness, n_dofs))
            if (maxval(abs(g + transpose(g))) > 1.0e-10_wp*maxval(abs(g))) then
               call fail(error, "matrices: the gyroscopic matrix must be skew-symmetric, G(j, i) = -G(i, j); "// &
                         "what dissipates belongs to the damping matrix")
            else
               call new_structure(structure, m, d + g + proportional%matrix(m, k), k, words(labels), words(units), error)
            end if
         end associate
      end if
      call annotate(error, group%place())
   end subroutine read_matrices

   !> Adds a problem unless there are as many values as in a full or a diagonal matrix.
   subroutine check_matrix(group, key, values, n_dofs)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      real(wp), intent(in) :: values(:)
      integer, intent(in) :: n_dofs

      if (size(values) == n_dofs .or. size(values) == n_dofs**2) return
      call group%problem(key, "needs "//to_text(n_dofs**2)//" values row by row, or "//to_text(n_dofs)// &
                         " for a diagonal matrix; there are "//to_text(size(values)))
   end subroutine check_matrix

   !> Matrix from its rows one after the other, or from its diagonal.
   pure function full(values, n) result(matrix)
      real(wp), intent(in) :: values(:)                      !! n**2 or n of them
      integer, intent(in) :: n
      real(wp) :: matrix(n, n)
      integer :: i

      if (size(values) == n**2) then
         matrix = transpose(reshape(values, [n, n]))
      else
         matrix = 0.0_wp
         do i = 1, n
            matrix(i, i) = values(i)
         end do
      end if
   end function full

   !> Texts of a list in one length, with room enough to notice those that are too long.
   pure function words(list)
      type(string_t), intent(in) :: list(:)
      character(label_length + 1) :: words(size(list))
      integer :: i

      do i = 1, size(list)
         words(i) = list(i)%value
      end do
   end function words
end module hb_matrices
